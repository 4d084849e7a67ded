"""Text files as lines and numbers, for every reader of text."""

from __future__ import annotations

import re
from pathlib import Path

from splatcl.errors import FileError

SEPARATORS = str.maketrans(",;\t", "   ")
COMMENT = re.compile(r"#|//")


def read_lines(path: Path) -> list[str]:
    """Return a text file's lines, whatever ends them.

    Raises
    ------
    FileError
        The file has a zero byte, so it is not text.
    """
    data = path.read_bytes()
    if b"\0" in data:
        raise FileError(f"{path}: byte {data.index(0)} is zero: this is not a text file")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("latin-1")
    return text.replace("\r\n", "\n").replace("\r", "\n").split("\n")


def number_lines(lines: list[str], continued: bool = False) -> list[tuple[int, str]]:
    """Return (line number from 1, text without comment) for the lines that hold something.

    With `continued`, a backslash at a line's end joins the next line to it.
    """
    numbered, begun, start = [], "", 0
    for number, line in enumerate(lines, 1):
        start = start if begun else number
        if continued and line.rstrip().endswith("\\"):
            begun += line.rstrip()[:-1] + " "
            continue
        text = (begun + line).partition("#")[0].strip()
        begun = ""
        if text:
            numbered.append((start, text))
    return numbered


def bare(line: str) -> str:
    """Return the line without its comment and with blanks for separators."""
    return COMMENT.split(line, maxsplit=1)[0].translate(SEPARATORS).strip()
