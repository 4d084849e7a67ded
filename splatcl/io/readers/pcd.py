"""PCD, the point clouds of PCL, through pypcd4: ASCII, binary and compressed."""

from __future__ import annotations

import io
import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splatcl.errors import FileError
from splatcl.io.readers.color import linear_color
from splatcl.io.readers.model import Model, foreign_errors, require

ASCII = re.compile(rb"^DATA\s+ascii\s*$", re.MULTILINE | re.IGNORECASE)
DATA = re.compile(rb"^DATA[ \t]+(ascii|binary_compressed|binary)[ \t]*\r?\n", re.MULTILINE | re.IGNORECASE)
MAX_HEADER = 4096


def read_pcd(path: Path) -> Model:
    """Read a PCD file; `rgb` and `rgba` are packed 8-bit sRGB.

    Raises
    ------
    FileError
        pypcd4 is missing, the file is damaged, or its counts contradict each other.
    """
    pypcd4 = require(path, "pypcd4", "pcd")
    data = path.read_bytes()
    kind = "ascii" if ASCII.search(data[:MAX_HEADER]) else "binary"
    if kind == "ascii":  # pypcd4 splits at single blanks
        data = b"\n".join(re.sub(rb"[ \t]+", b" ", line).strip() for line in data.splitlines())
    _check_header(path, data)
    notes: list[str] = []
    with foreign_errors(path, "PCD file", notes):
        cloud = pypcd4.PointCloud.from_fileobj(io.BytesIO(data))
        rows = np.atleast_1d(cloud.pc_data)
        head = cloud.metadata
    if head.width * head.height != head.points or len(rows) != head.points:
        raise FileError(
            f"{path}: WIDTH {head.width} x HEIGHT {head.height}, POINTS {head.points}, but {len(rows)} points are "
            "there; the header is wrong or the file was cut"
        )
    columns = {name.lower(): rows[name] for name in rows.dtype.names or ()}
    missing = [name for name in "xyz" if name not in columns]
    if missing:
        raise FileError(f"{path}: has no field {missing[0]}; its FIELDS are {' '.join(columns)}")
    if tuple(head.viewpoint) != (0, 0, 0, 1, 0, 0, 0):
        notes.append("ignored VIEWPOINT: points are taken as they stand")
    normals = _stack(columns, ("normal_x", "normal_y", "normal_z"))
    packed = next((name for name in ("rgb", "rgba") if name in columns), None)
    used = {"x", "y", "z", packed, *(("normal_x", "normal_y", "normal_z") if normals is not None else ())}
    ignored = [name for name in columns if name not in used and not name.startswith("#")]
    if ignored:
        notes.append(f"ignored {', '.join(ignored)}")
    color = None if packed is None else linear_color(_unpack(path, packed, columns[packed]), notes)
    return Model(path, f"PCD ({kind})", _stack(columns, ("x", "y", "z")), normals, color, notes=tuple(notes))


def _check_header(path: Path, data: bytes) -> None:
    """Refuse counts that exceed the file's bytes, before memory is set aside for them."""
    for found in re.finditer(rb"^(COUNT|POINTS|SIZE)[ \t]+([^\r\n]*)", data[:MAX_HEADER], re.MULTILINE):
        numbers = [int(word) for word in found.group(2).split() if word.isdigit()]
        if max(numbers, default=0) > len(data):
            raise FileError(
                f"{path}: {found.group(1).decode()} is {max(numbers)}, but the file has only {len(data)} bytes"
            )
    _check_end(path, data)


def _check_end(path: Path, data: bytes) -> None:
    """Refuse a file that ends before its last point."""
    head = DATA.search(data[:MAX_HEADER])
    if head is None:
        return
    lines = re.finditer(rb"^(SIZE|COUNT|POINTS)[ \t]+([\d \t]+)", data[: head.start()], re.MULTILINE | re.IGNORECASE)
    numbers = {line.group(1).upper(): [int(word) for word in line.group(2).split()] for line in lines}
    sizes, points = numbers.get(b"SIZE", []), numbers.get(b"POINTS", [0])[0]
    counts = numbers.get(b"COUNT") or [1] * len(sizes)
    start, kind = head.end(), head.group(1).lower()
    if kind == b"ascii":
        last = data[start:].rstrip().rpartition(b"\n")[2].split()
        if 0 < len(last) < sum(counts):
            raise FileError(
                f"{path}: its last line has {len(last)} of {sum(counts)} numbers: {sum(counts) - len(last)} are "
                "missing; the file was cut"
            )
        return
    need = points * sum(size * count for size, count in zip(sizes, counts, strict=False))
    if kind == b"binary_compressed":
        need = 8 + int.from_bytes(data[start : start + 4], "little")
    if len(data) - start < need:
        raise FileError(
            f"{path}: the data of its {points} points take {need} bytes from byte {start} on, of which "
            f"{need - len(data) + start} are missing; the file was cut"
        )


def _stack(columns: dict[str, NDArray[Any]], names: tuple[str, ...]) -> Any:
    if not all(name in columns for name in names):
        return None
    return np.stack([columns[name] for name in names], axis=1)


def _unpack(path: Path, name: str, column: NDArray[Any]) -> NDArray[np.uint8]:
    """Return (N, 3) bytes of colors packed as 0xRRGGBB into 4 bytes of any type."""
    if column.dtype.itemsize != 4:
        raise FileError(f"{path}: field {name} has {column.dtype.itemsize} bytes; a packed color has 4")
    bits = np.ascontiguousarray(column).view(np.uint32)
    return (np.stack([bits >> 16, bits >> 8, bits], axis=1) & 255).astype(np.uint8)
