"""Points as text: XYZ, PWN, PTS, TXT, CSV, and the scans of PTX."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from splatcl.errors import FileError
from splatcl.io.readers.color import linear_color
from splatcl.io.readers.lines import COMMENT, SEPARATORS, bare, parse_floats, read_lines
from splatcl.io.readers.model import RGB, XYZ, Model, stack_columns

NAMES = {
    "x": "x", "y": "y", "z": "z", "nx": "nx", "ny": "ny", "nz": "nz", "radius": "radius",
    "r": "red", "g": "green", "b": "blue", "red": "red", "green": "green", "blue": "blue",
}  # fmt: skip
"""Name of a column in a file -> its name here."""
NORMAL = ("nx", "ny", "nz")
"""Names of the columns of a normal."""
SIX_COLUMNS = (".pwn", ".xyzn", ".xyzrgb")
"""Extensions that define the meaning of six columns."""
DECIMAL_COMMAS = re.compile(r"[+-]?\d+,\d+(?:[\s;]+[+-]?\d+,\d+)+")
"""A line whose commas look like decimal commas: other separators stand between pairs of numbers."""


def read_text(path: Path) -> Model:
    """Read one point per line: x y z, then normals and colors if there are more numbers.

    Numbers are float64, separated by blanks, commas, semicolons or tabs; ``#`` and ``//`` begin a comment. The first
    line may give the number of points or name the columns. Otherwise the columns are guessed, with a note.

    Raises
    ------
    FileError
        The file is not text, a word is not a number, lines differ in length, or the count is wrong; the message
        names the line.
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
    separate = path.suffix.lower() == ".pwn" and announced and len(table) == 2 * announced and table.shape[1] == 3
    if separate:  # all points precede all normals
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
    """Read the scans of a PTX file and transform each by its own 4x4 matrix, which acts on row vectors.

    A point at the exact origin of the scanner is a missing return; such points are dropped and counted.

    Raises
    ------
    FileError
        Counts, a matrix or points are missing or not numbers; the message names the line.
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
                f"{path}: line {start + 1} does not begin a PTX scan; a scan must begin with columns, rows, 4 lines of "
                "scanner pose and 4 lines of matrix"
            ) from None
        start += 10
        if num < 0 or start + num > len(lines):
            raise FileError(
                f"{path}: line {start - 9} announces {num} points but {len(lines) - start} lines follow line {start}; "
                "correct the count or complete the file"
            )
        scan = _table(path, lines[: start + num], start)
        scan[:, :3], hit = _transform(scan[:, :3], matrix), scan[:, :3].any(axis=1)
        scans.append((scan[hit], len(scan) - np.count_nonzero(hit)))
        start += num
    widths = {scan.shape[1] for scan, _ in scans}
    if len(widths) != 1:
        raise FileError(f"{path}: its scans have {sorted(widths)} numbers per point; the number must be the same")
    table = np.concatenate([scan for scan, _ in scans])
    missing = sum(count for _, count in scans)
    notes = [f"dropped {missing} missing returns (points at 0 0 0)"] if missing else []
    return _model(path, table, _guess_columns(path, table), notes)


def _transform(points: NDArray[np.float64], matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    with np.errstate(over="ignore", invalid="ignore"):
        return points @ matrix[:3, :3] + matrix[3, :3]


def _column_names(lines: list[str]) -> list[str]:
    """Return the names of the columns from a line such as "x y z nx ny nz" or "//X,Y,Z,R,G,B", or no name."""
    for line in lines:
        words = line.lower().translate(SEPARATORS).replace("#", " ").replace("//", " ").split()
        if words[:3] == ["x", "y", "z"]:
            return [NAMES.get(word, word) for word in words]
    return []


def _table(path: Path, lines: list[str], start: int) -> NDArray[np.float64]:
    """Return the (N, C) numbers of the lines from index `start` on."""
    rows = [line for line in map(bare, lines[start:]) if line]
    if not rows:
        raise FileError(f"{path}: has no points")
    try:
        table = np.loadtxt(rows, np.float64, comments=None, ndmin=2)
    except ValueError as error:
        _check_lines(path, lines, start)
        raise FileError(f"{path}: not points as text ({error})") from None
    if table.shape[1] < 3:
        _check_lines(path, lines, start)
    return table


def _check_lines(path: Path, lines: list[str], start: int) -> None:
    """Raise a `FileError` about the first line that is no point."""
    width = None
    for number, line in enumerate(lines[start:], start + 1):
        words = bare(line).split()
        parse_floats(path, number, words)
        if words and len(words) < 3:
            raise FileError(f"{path}: line {number} has {len(words)} numbers; a point must have x y z")
        if words and width not in (None, len(words)):
            raise FileError(
                f"{path}: line {number} has {len(words)} numbers but the lines before have {width}; complete the line"
            )
        width = len(words) or width


def _guess_columns(path: Path, table: NDArray[np.float64]) -> list[str]:
    """Guess the names of the columns from their number, the extension, and whether three of them are bytes."""
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
            f"{path}: has {num} numbers per line; it must have 3, 4, 6, 7, 9 or 10, or column names in the first line "
            "(x y z nx ny nz red green blue)"
        )
    return [*XYZ, *layouts[num]]


def _guess_note(names: list[str], lines: list[str]) -> str:
    """Return a note on the guessed columns, and on commas that look like decimal commas."""
    note = f"took the {len(names)} numbers of a line as {' '.join(names)}; if wrong, name them in the first line"
    first = next(COMMENT.split(line, maxsplit=1)[0].strip() for line in lines if bare(line))
    if DECIMAL_COMMAS.fullmatch(first):
        note += "; took commas as separators: write decimal points, not commas"
    return note


def _model(path: Path, table: NDArray[np.float64], names: list[str], notes: list[str]) -> Model:
    columns = {name: table[:, index] for index, name in enumerate(names)}
    normals, color = stack_columns(columns, NORMAL), stack_columns(columns, RGB)
    if color is not None and _are_bytes(color):
        color = color.astype(np.uint8)
    if color is not None:
        color = linear_color(color, notes)
    used = {*XYZ, "radius", *(() if normals is None else NORMAL), *(() if color is None else RGB)}
    unused = [name for name in names if name not in used]
    if unused:
        notes.append(f"ignored column{'s' * (len(unused) > 1)} {', '.join(unused)}")
    kind = f"{path.suffix.lstrip('.').upper() or 'text'} (text)"
    points, radius = stack_columns(columns, XYZ), columns.get("radius")
    return Model(path, kind, points, normals, color, radius, notes=tuple(notes))


def _are_bytes(color: NDArray[np.float64]) -> bool:
    """Return whether colors are integers from 0 to 255, and not all of them 0 or 1."""
    with np.errstate(invalid="ignore"):
        return bool(((color >= 0) & (color <= 255) & (color == np.floor(color))).all() and (color > 1).any())
