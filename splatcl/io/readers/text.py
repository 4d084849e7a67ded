"""Points in text: XYZ, PWN, PTS, TXT, CSV and the scans of PTX."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splatcl.errors import FileError
from splatcl.io.readers.color import linear_color
from splatcl.io.readers.lines import SEPARATORS, bare, read_lines
from splatcl.io.readers.model import Model

NAMES = {
    "x": "x", "y": "y", "z": "z", "nx": "nx", "ny": "ny", "nz": "nz", "radius": "radius",
    "r": "red", "g": "green", "b": "blue", "red": "red", "green": "green", "blue": "blue",
}  # fmt: skip
XYZ, NORMAL, RGB = ("x", "y", "z"), ("nx", "ny", "nz"), ("red", "green", "blue")
COMMENT = re.compile(r"#|//")
SIX_COLUMNS = (".pwn", ".xyzn", ".xyzrgb")
"""Formats in which six columns mean one thing."""
DECIMAL_COMMAS = re.compile(r"[+-]?\d+,\d+(?:[\s;]+[+-]?\d+,\d+)+")
"""A line on which each comma looks like a decimal one: other separators stand between pairs."""


def read_text(path: Path) -> Model:
    """Read one point per line: x y z, then normals and colors where there are more numbers.

    Numbers are parsed as float64, separated by blanks, commas, semicolons or tabs; ``#`` and ``//`` begin a
    comment; the first line may hold the number of points or name the columns, which are guessed with a note where
    it does not.

    Raises
    ------
    FileError
        Not text, not numbers, lines of different lengths, or a count that is wrong; the message names the line.
    """
    lines = read_lines(path)
    start = next((i for i, line in enumerate(lines) if bare(line)), len(lines))
    names = _column_names(lines[:start])
    announced = None
    if start < len(lines) and not names:
        head = bare(lines[start]).split()
        names = _column_names([lines[start]])
        announced = int(head[0]) if len(head) == 1 and head[0].isascii() and head[0].isdigit() else None
        start += bool(names) or announced is not None
    table = _table(path, lines, start)
    split = path.suffix.lower() == ".pwn" and announced and len(table) == 2 * announced and table.shape[1] == 3
    if split:  # all points, then all normals
        table = np.hstack([table[:announced], table[announced:]])
    if announced is not None and len(table) != announced:
        raise FileError(
            f"{path}: line {start} announces {announced} points but {len(table)} follow; "
            "correct the count or complete the file"
        )
    if names and len(names) != table.shape[1]:
        raise FileError(f"{path}: {len(names)} columns are named but line {start + 1} has {table.shape[1]} numbers")
    if names:
        return _model(path, table, names, [])
    names = _guess_columns(path, table)
    certain = len(names) == 3 or (len(names) == 6 and path.suffix.lower() in SIX_COLUMNS)
    return _model(path, table, names, [] if certain else [_guess_note(names, lines[start:])])


def read_ptx(path: Path) -> Model:
    """Read the scans of a PTX file; each is placed by its own 4x4 matrix (acts on row vectors).

    Points at the scanner's exact origin are missing returns; they are left out and counted.

    Raises
    ------
    FileError
        Counts, matrix or points are missing or not numbers; the message names the line.
    """
    lines = read_lines(path)
    while lines and not lines[-1].strip():
        lines.pop()
    scans, start = [], 0
    while start < len(lines):
        head = lines[start : start + 10]
        try:
            num = int(head[0]) * int(head[1])
            matrix = np.array([line.split() for line in head[6:10]], np.float64).reshape(4, 4)
        except (ValueError, IndexError):
            raise FileError(
                f"{path}: line {start + 1} does not begin a PTX scan (columns, rows, 4 lines of scanner pose, "
                "4 lines of matrix)"
            ) from None
        start += 10
        if num < 0 or start + num > len(lines):
            raise FileError(
                f"{path}: line {start - 9} announces {num} points but {len(lines) - start} lines follow line {start}"
            )
        scan = _table(path, lines[: start + num], start)
        scan[:, :3], hit = _place(scan[:, :3], matrix), scan[:, :3].any(axis=1)
        scans.append((scan[hit], len(scan) - np.count_nonzero(hit)))
        start += num
    widths = {scan.shape[1] for scan, _ in scans}
    if len(widths) != 1:
        raise FileError(f"{path}: its scans have {sorted(widths)} numbers per point; they must agree")
    table = np.concatenate([scan for scan, _ in scans])
    missing = sum(count for _, count in scans)
    notes = [f"left out {missing} missing returns (points at 0 0 0)"] if missing else []
    return _model(path, table, _guess_columns(path, table), notes)


def _place(points: NDArray[np.float64], matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    with np.errstate(over="ignore", invalid="ignore"):
        return points @ matrix[:3, :3] + matrix[3, :3]


def _column_names(lines: list[str]) -> list[str]:
    """Return the columns' names where a line gives them ("x y z nx ny nz", "//X,Y,Z,R,G,B"), else nothing."""
    for line in lines:
        words = line.lower().translate(SEPARATORS).replace("#", " ").replace("//", " ").split()
        if words[:3] == ["x", "y", "z"]:
            return [NAMES.get(word, word) for word in words]
    return []


def _table(path: Path, lines: list[str], start: int) -> NDArray[np.float64]:
    """Return the (N, C) numbers of the lines from index `start` on."""
    rows = [line for line in map(bare, lines[start:]) if line]
    if not rows:
        raise FileError(f"{path}: holds no points")
    try:
        table = np.loadtxt(rows, np.float64, comments=None, ndmin=2)
    except ValueError as error:
        raise FileError(_bad_line(path, lines, start) or f"{path}: not points in text ({error})") from None
    if table.shape[1] < 3:
        raise FileError(_bad_line(path, lines, start) or f"{path}: fewer than 3 numbers per line; x y z are needed")
    return table


def _bad_line(path: Path, lines: list[str], start: int) -> str | None:
    """Find the first line that is no point, and say what is wrong with it."""
    width = None
    for index, line in enumerate(lines[start:], start + 1):
        words = bare(line).split()
        for word in words:
            try:
                float(word)
            except ValueError:
                return f"{path}: line {index}: {word[:40]!r} is not a number"
        if words and len(words) < 3:
            return f"{path}: line {index} has {len(words)} numbers; a point needs x y z"
        if words and width not in (None, len(words)):
            return f"{path}: line {index} has {len(words)} numbers but the lines before have {width}"
        width = len(words) or width
    return None


def _guess_columns(path: Path, table: NDArray[np.float64]) -> list[str]:
    """Name the columns after their number, the extension and whether three of them are whole numbers to 255."""
    num = table.shape[1]

    three = list(RGB if path.suffix.lower() == ".xyzrgb" or (num >= 6 and _are_bytes(table[:, 3:6])) else NORMAL)
    late_color = num >= 7 and (_are_bytes(table[:, 4:7]) or path.suffix.lower() in (".pts", ".ptx"))
    layouts = {
        3: [],
        4: ["intensity"],
        6: three,
        7: ["intensity", *RGB] if late_color else [*three, "intensity"],
        9: [*three, *(NORMAL if three == list(RGB) else RGB)],
        10: ["intensity", *RGB, *NORMAL] if late_color else [*NORMAL, "intensity", *RGB],
    }
    if num not in layouts:
        raise FileError(
            f"{path}: {num} numbers per line; 3, 4, 6, 7, 9 or 10 are understood, or name the columns in the "
            "first line (x y z nx ny nz red green blue)"
        )
    return [*XYZ, *layouts[num]]


def _guess_note(names: list[str], lines: list[str]) -> str:
    """Say how the columns were taken, and that commas separate numbers where they look like decimal ones."""
    note = f"took the {len(names)} numbers of a line as {' '.join(names)}; name them in the first line if they are not"
    first = next(COMMENT.split(line, maxsplit=1)[0].strip() for line in lines if bare(line))
    if DECIMAL_COMMAS.fullmatch(first):
        note += "; commas separate numbers here: write decimal points, not commas"
    return note


def _model(path: Path, table: NDArray[np.float64], names: list[str], notes: list[str]) -> Model:
    columns = {name: table[:, index] for index, name in enumerate(names)}

    def group(wanted: tuple[str, ...]) -> Any:
        return np.stack([columns[n] for n in wanted], axis=1) if all(n in columns for n in wanted) else None

    color = group(RGB)
    if color is not None and _are_bytes(color):
        color = color.astype(np.uint8)
    if color is not None:
        color = linear_color(color, notes)
    known = {
        *XYZ,
        "radius",
        *(NORMAL if group(NORMAL) is not None else ()),
        *(RGB if color is not None else ()),
    }
    unused = [name for name in names if name not in known]
    if unused:
        notes.append(f"ignored column{'s' * (len(unused) > 1)} {', '.join(unused)}")
    kind = path.suffix.lstrip(".").upper() or "text"
    return Model(path, f"{kind} (text)", group(XYZ), group(NORMAL), color, columns.get("radius"), notes=tuple(notes))


def _are_bytes(color: NDArray[np.float64]) -> bool:
    """Return whether colors are whole numbers to 255, not all of them 0 or 1."""
    with np.errstate(invalid="ignore"):
        return bool(((color >= 0) & (color <= 255) & (color == np.floor(color))).all() and (color > 1).any())
