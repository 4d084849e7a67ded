"""PLY: points, meshes, range scans, Gaussian splats and splatcl's own splats."""

from __future__ import annotations

import re
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splatcl.errors import FileError
from splatcl.io.readers import gaussians, native
from splatcl.io.readers.color import linear_color
from splatcl.io.readers.model import RGB, XYZ, Model, foreign_errors, stack_columns
from splatcl.io.readers.polygons import triangulate, triangulate_strips

NORMALS = (("nx", "ny", "nz"), ("normal_x", "normal_y", "normal_z"))
"""Names of the properties of a normal."""
COLORS = (RGB, ("r", "g", "b"), ("diffuse_red", "diffuse_green", "diffuse_blue"))
"""Names of the properties of a color."""
INDEX_LISTS = ("vertex_indices", "vertex_index")
"""Names of the list of a face's vertex indices."""
FORMATS = {"<": "binary little-endian", ">": "binary big-endian"}
HEADER = re.compile(rb"\A(.*?[\r\n])[ \t]*end_header[ \t]*(?:\r\n|\n|\r)", re.DOTALL)
MAX_HEADER = 1 << 20
"""Bytes in which a header is searched."""


def read_ply(path: Path) -> Model:
    """Read a PLY file: ASCII, or binary in either byte order; unknown properties and elements are ignored.

    8- and 16-bit colors are sRGB; float colors are linear.

    Raises
    ------
    FileError
        The header or the data are damaged or truncated, or no element has x y z; the message names the element and
        the row.
    """
    notes: list[str] = []
    ply = _parse(path, notes)
    if ply.text:
        _check_end(path, sum(element.count for element in ply))
    elements = {element.name.lower(): element for element in ply}
    names = [name for name in elements if set(XYZ) <= {p.name.lower() for p in elements[name].properties}]
    if not names:
        present = ", ".join(f"{e.name} ({' '.join(p.name for p in e.properties)})" for e in ply) or "none"
        raise FileError(f"{path}: has no element with properties x y z; its elements are: {present[:300]}")
    vertex = "vertex" if "vertex" in names else names[0]
    columns = _columns(elements[vertex], scalar=True)
    kind = f"PLY ({FORMATS[ply.byte_order] if not ply.text else 'ascii'})"
    if columns.keys() >= native.COLUMNS:
        return native.from_columns(path, kind, columns, ply.comments)
    if columns.keys() >= gaussians.COLUMNS:
        return gaussians.from_columns(path, kind, columns, notes)
    faces, face_color = _faces(path, elements, notes)
    used, radius = {*XYZ, "radius"}, columns.get("radius")
    normals, color = _first(columns, NORMALS, used), _first(columns, COLORS, used)
    ignored = [name for name in columns if name not in used and name != "alpha"]
    ignored += [f"element {e.name}" for e in ply if e.name.lower() not in (vertex, "face", "tristrips")]
    if ignored:
        notes.append(f"ignored {', '.join(ignored[:12])}{' ...' * (len(ignored) > 12)}")
    return Model(
        path,
        kind,
        stack_columns(columns, XYZ),
        normals,
        None if color is None else linear_color(color, notes),
        None if radius is None else radius.astype(radius.dtype.newbyteorder("=")),
        faces=faces,
        face_color=None if face_color is None else linear_color(face_color, notes),
        notes=tuple(notes),
    )


def _parse(path: Path, notes: list[str]) -> Any:
    """Parse a file through plyfile; if it rejects the header, parse a copy with a mended one."""
    from plyfile import PlyHeaderParseError

    _check_counts(path)
    with foreign_errors(path, "PLY file", notes):
        try:
            return _read(path)
        except (PlyHeaderParseError, UnicodeDecodeError):
            header = _header(path)
            if header is None:
                raise
            # plyfile rejects trailing blanks, mixed line ends and letters beyond ASCII. The copy must be a file to be
            # mapped.
            with tempfile.NamedTemporaryFile(suffix=".ply") as copy:
                lines = [line.rstrip() for line in re.split(rb"\r\n|\n|\r", header.group(1)) if line.strip()]
                copy.write(re.sub(rb"[^\x00-\x7f]", b"?", b"\n".join([*lines, b"end_header", b""])))
                copy.write(path.read_bytes()[header.end() :])
                copy.flush()
                return _read(Path(copy.name))


def _read(path: Path) -> Any:
    from plyfile import PlyData, PlyElementParseError

    with path.open("rb") as stream:
        try:  # faces of triangles only can be mapped, which is far faster
            return PlyData.read(stream, known_list_len={"face": dict.fromkeys(INDEX_LISTS, 3)})
        except PlyElementParseError as error:
            if "list length" not in str(error):
                raise
            stream.seek(0)
            return PlyData.read(stream)


def _header(path: Path) -> re.Match[bytes] | None:
    with path.open("rb") as stream:
        return HEADER.search(stream.read(MAX_HEADER))


def property_names(path: Path) -> frozenset[str]:
    """Return the names of all properties in a file's header, in lower case; no name without a header."""
    header = _header(path)
    found = re.findall(
        rb"^[ \t]*property[ \t].*?(\S+)[ \t]*$", header.group(1).replace(b"\r", b"\n") if header else b"", re.M
    )
    return frozenset(name.decode("ascii", "replace").lower() for name in found)


def _check_counts(path: Path) -> None:
    """Raise `FileError` if the header announces less than 0 rows, or more rows than the file has bytes.

    plyfile would allocate memory for them.
    """
    header = _header(path)
    if header is None:
        raise FileError(f"{path}: the PLY header has no end_header line; the file is damaged or truncated")
    size = path.stat().st_size
    for index, line in enumerate(re.split(rb"\r\n|\n|\r", header.group(1)), 1):
        found = re.match(rb"\s*element\s+(\S+)\s+(-?\d+)", line)
        num = int(found.group(2)) if found else 0
        if found and not 0 <= num <= size:
            name = found.group(1).decode("ascii", "replace")
            raise FileError(
                f"{path}: line {index} announces {num} rows of element {name}, but the file has only {size} bytes"
                if num > 0
                else f"{path}: line {index} announces {num} rows of element {name}; correct the count"
            )


def _check_end(path: Path, num_rows: int) -> None:
    """Raise `FileError` if lines follow the last row of an ASCII file: its header announces too few rows."""
    header = _header(path)
    if header is None:
        return
    data = path.read_bytes()
    start = len(data[: header.end()].splitlines())
    for number, line in enumerate(data[header.end() :].splitlines()[num_rows:], start + num_rows + 1):
        if line.strip():
            raise FileError(
                f"{path}: line {number} follows the last of the {num_rows} rows that the header announces; "
                "correct its counts or remove the lines"
            )


def _columns(element: Any, scalar: bool) -> dict[str, NDArray[Any]]:
    """Return the scalar properties of an element, or its list properties, by lower-case name.

    They are views of the mapped file, in its byte order; `np.stack` makes native copies.
    """
    from plyfile import PlyListProperty

    return {
        prop.name.lower(): np.asarray(element.data[prop.name])
        for prop in element.properties
        if isinstance(prop, PlyListProperty) != scalar
    }


def _first(
    columns: dict[str, NDArray[Any]], groups: tuple[tuple[str, ...], ...], used: set[str]
) -> NDArray[Any] | None:
    """Stack the first group of names without a missing column, and add its names to `used`."""
    for names in groups:
        if (stacked := stack_columns(columns, names)) is not None:
            used.update(names)
            return stacked
    return None


def _faces(path: Path, elements: dict[str, Any], notes: list[str]) -> tuple[Any, Any]:
    """Return (F, 3) triangles or None, and their (F, 3) stored colors or None."""
    if "tristrips" in elements:
        lists = _columns(elements["tristrips"], scalar=False)
        strips = next((lists[name] for name in INDEX_LISTS if name in lists), None)
        if strips is not None and len(strips):
            return triangulate_strips(list(strips)), None
    if "face" not in elements or not elements["face"].count:
        return None, None
    lists = _columns(elements["face"], scalar=False)
    index = next((lists[name] for name in INDEX_LISTS if name in lists), None)
    if index is None:
        present = ", ".join(lists) or "none"
        raise FileError(f"{path}: element face has no list vertex_indices; its lists are: {present}")
    faces, source = triangulate(index, notes)
    color = _first(_columns(elements["face"], scalar=True), COLORS, set())
    return faces, None if color is None else color[source]
