"""OBJ meshes and points.

trimesh reads OBJ too, but it rounds vertex colors to 8 bits and truncates lines of unequal length silently. It counts
relative indices from the end of the file.
"""

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

WIDTHS = {3: 3, 4: 3, 6: 6, 7: 6}
"""Number of numbers on a vertex line, x y z (w) or x y z r g b (a) -> number of those that are used."""


def read_obj(path: Path) -> Model:
    """Read the vertices (with linear colors), the faces and, without faces, the normals of an OBJ file.

    Raises
    ------
    FileError
        A word is not a number, or a face has an index out of range; the message names the line or the face.
    """
    rows: dict[str, list[list[float]]] = {"v": [], "vn": []}
    polygons: list[list[int]] = []
    ignored = set()
    for number, text in number_lines(read_lines(path), continued=True):
        key, *words = text.split()
        if key in rows:
            rows[key].append(_vertex(path, number, key, words))
        elif key == "f":
            polygons.append(_face(path, number, words, len(rows["v"])))
        elif key not in ("o", "g", "s"):
            ignored.add(key)
    vertices = _vertices(path, rows["v"])
    notes: list[str] = []
    if ignored:
        notes.append(f"ignored lines of {', '.join(sorted(ignored)[:12])}")
    triangles, _ = triangulate(polygons, notes)
    normals = np.array(rows["vn"]) if rows["vn"] and not polygons and len(rows["vn"]) == len(vertices) else None
    if rows["vn"] and normals is None:
        reason = "the winding of faces decides" if polygons else "their number differs from that of points"
        notes.append(f"ignored normals: {reason}")
    return Model(
        path,
        "OBJ (text)",
        vertices[:, :3],
        normals,
        linear_color(vertices[:, 3:], notes) if vertices.shape[1] == 6 else None,
        faces=triangles if len(triangles) else None,
        notes=tuple(notes),
    )


def _vertex(path: Path, number: int, key: str, words: list[str]) -> list[float]:
    """Return the used numbers of a vertex or normal line, 3 or 6."""
    values = parse_floats(path, number, words)
    width = WIDTHS.get(len(values), 0) if key == "v" else 3 * (len(values) == 3)
    if not width:
        raise FileError(f"{path}: line {number}: '{key}' has {len(values)} numbers; it must have 3 (or 6 with color)")
    return values[:width]


def _face(path: Path, number: int, words: list[str], num_vertices: int) -> list[int]:
    """Return the vertex indices, from 0, of "f 1/2/3 4//5 -1"; a negative index counts from the last vertex."""
    corners = parse_integers(path, number, [word.partition("/")[0] for word in words])
    if 0 in corners or any(corner < -num_vertices for corner in corners):
        raise FileError(f"{path}: line {number} refers to a vertex before the first; indices begin at 1")
    return [corner - 1 if corner > 0 else num_vertices + corner for corner in corners]


def _vertices(path: Path, rows: list[list[float]]) -> NDArray[Any]:
    widths = {len(row) for row in rows}
    if widths == {3, 6}:
        raise FileError(f"{path}: some vertices have no color; give all vertices a color, or none")
    return np.array(rows, np.float64).reshape(len(rows), max(widths, default=3))
