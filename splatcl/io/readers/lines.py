"""Text files as lines and numbers, for all readers of text."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeVar

from splatcl.errors import FileError

T = TypeVar("T", int, float)

SEPARATORS = str.maketrans(",;\t", "   ")
"""Translation of separators to blanks."""
COMMENT = re.compile(r"#|//")
"""Beginning of a comment."""


def read_lines(path: Path) -> list[str]:
    """Return the lines of a text file with any kind of line ends.

    Raises
    ------
    FileError
        The file has a zero byte, so it is not text.
    """
    data = path.read_bytes()
    if b"\0" in data:
        raise FileError(f"{path}: byte {data.index(0)} is zero; the file must be text")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("latin-1")
    return text.replace("\r\n", "\n").replace("\r", "\n").split("\n")


def number_lines(lines: list[str], continued: bool = False) -> list[tuple[int, str]]:
    """Return (line number from 1, text without comment) for each line that is not empty.

    With `continued`, a backslash at the end of a line joins the next line to it.
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
    """Return a line without its comment and with blanks as separators."""
    return COMMENT.split(line, maxsplit=1)[0].translate(SEPARATORS).strip()


def parse_floats(path: Path, number: int, words: Sequence[str]) -> list[float]:
    """Parse the words of a line; raise a `FileError` that names the line and the first word that is no number."""
    return _parse(float, "a number", path, number, words)


def parse_integers(path: Path, number: int, words: Sequence[str]) -> list[int]:
    """Parse the words of a line; raise a `FileError` that names the line and the first word that is no integer."""
    return _parse(int, "an integer", path, number, words)


def _parse(kind: Callable[[str], T], noun: str, path: Path, number: int, words: Sequence[str]) -> list[T]:
    values: list[T] = []
    try:
        values.extend(map(kind, words))
    except ValueError:
        bad = words[len(values)]
        raise FileError(f"{path}: line {number}: {bad[:40]!r} must be {noun}") from None
    return values
