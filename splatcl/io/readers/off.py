"""OFF and COFF meshes; trimesh reads OFF too, but without colors."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splatcl.errors import FileError
from splatcl.io.readers.color import linear_color
from splatcl.io.readers.lines import number_lines, parse_floats, parse_integers, read_lines
from splatcl.io.readers.model import Model
from splatcl.io.readers.polygons import triangulate

HEADERS = {"OFF": 3, "COFF": 3, "NOFF": 6, "CNOFF": 6}
"""Keyword of the header -> number of numbers before the color on a vertex line."""


def read_off(path: Path) -> Model:
    """Read the vertices, the polygons and the colors of either from an OFF file.

    Integer colors are 8-bit sRGB; colors with a decimal point are linear.

    Raises
    ------
    FileError
        The file has no OFF header, its counts are wrong, or a word is not a number; the message names the line.
    """
    lines = number_lines(read_lines(path))
    word, counts = _header(path, lines)
    num_vertices, num_faces = counts
    if num_vertices + num_faces > len(lines):
        raise FileError(
            f"{path}: announces {num_vertices} vertices and {num_faces} faces but {len(lines)} lines follow; the file "
            "is truncated"
        )
    vertices = _table(path, lines[:num_vertices])
    faces, face_color = _faces(path, lines[num_vertices : num_vertices + num_faces])
    notes: list[str] = []
    width = HEADERS[word]
    if vertices.shape[1] < width:
        raise FileError(f"{path}: line {lines[0][0]} has {vertices.shape[1]} numbers; a vertex must have {width}")
    color = vertices[:, width : width + 3] if vertices.shape[1] in (width + 3, width + 4) else None
    triangles, source = triangulate(faces, notes)
    return Model(
        path,
        f"{word} (text)",
        vertices[:, :3],
        vertices[:, 3:6] if width == 6 else None,
        None if color is None else _linear(color, lines[:num_vertices], notes),
        faces=triangles if len(triangles) else None,
        face_color=None if face_color is None else _linear(face_color, lines[num_vertices:], notes)[source],
        notes=tuple(notes),
    )


def _header(path: Path, lines: list[tuple[int, str]]) -> tuple[str, tuple[int, int]]:
    """Remove the header from `lines`; return its keyword and the numbers of vertices and faces."""
    word = lines[0][1].split()[0].upper() if lines else ""
    if word not in HEADERS:
        known = ", ".join(HEADERS)
        raise FileError(f"{path}: begins with {word[:20]!r}; it must begin with one of {known}")
    rest = lines[0][1].split()[1:]
    number, text = lines.pop(0) if rest else lines.pop(1) if len(lines) > 1 else (1, "")
    if not rest:
        lines.pop(0)
    words = rest or text.split()
    try:
        num_vertices, num_faces = int(words[0]), int(words[1])
    except (ValueError, IndexError):
        num_vertices = num_faces = -1
    if num_vertices < 0 or num_faces < 0:
        raise FileError(f"{path}: line {number} must hold the numbers of vertices, faces and edges")
    return word, (num_vertices, num_faces)


def _table(path: Path, lines: list[tuple[int, str]]) -> NDArray[np.float64]:
    """Return the (N, C) numbers of lines of equal length."""
    rows = [parse_floats(path, number, text.split()) for number, text in lines]
    widths = [len(row) for row in rows]
    for (number, _), width in zip(lines, widths, strict=True):
        if width < 3 or width != widths[0]:
            raise FileError(f"{path}: line {number} has {width} numbers; a vertex must have {max(3, widths[0])}")
    return np.array(rows, np.float64).reshape(len(rows), max(widths, default=3))


def _faces(path: Path, lines: list[tuple[int, str]]) -> tuple[list[list[int]], NDArray[np.float64] | None]:
    """Return the polygons, and (F, 3) colors if every face has one."""
    polygons, colors = [], []
    for number, text in lines:
        words = text.split()
        size = parse_integers(path, number, words[:1])[0]
        polygon = parse_integers(path, number, words[1 : 1 + size])
        if size < 0 or len(polygon) != size:
            raise FileError(f"{path}: line {number} announces a face of {size} corners but has {len(polygon)}")
        polygons.append(polygon)
        rest = words[1 + size :]
        if len(rest) in (3, 4):
            colors.append(parse_floats(path, number, rest[:3]))
    return polygons, np.array(colors) if colors and len(colors) == len(polygons) else None


def _linear(color: NDArray[np.float64], lines: list[tuple[int, str]], notes: list[str]) -> Any:
    """Convert colors to linear RGB: numbers without a decimal point are bytes, sRGB."""
    decimal = "." in lines[0][1].split()[-1] or color.max(initial=0) > 255 or color.min(initial=0) < 0
    return linear_color(color if decimal or not np.isfinite(color).all() else color.astype(np.uint8), notes)
