"""PCD point clouds of PCL, read through pypcd4: ASCII, binary and compressed."""

from __future__ import annotations

import io
import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splatcl.errors import FileError
from splatcl.io.readers.color import linear_color
from splatcl.io.readers.model import XYZ, Model, foreign_errors, require, stack_columns

ASCII = re.compile(rb"^DATA\s+ascii\s*$", re.MULTILINE | re.IGNORECASE)
DATA = re.compile(rb"^DATA[ \t]+(ascii|binary_compressed|binary)[ \t]*\r?\n", re.MULTILINE | re.IGNORECASE)
MAX_HEADER = 4096
"""Bytes in which a header is searched."""
NORMAL = ("normal_x", "normal_y", "normal_z")
"""Fields of a normal."""


def read_pcd(path: Path) -> Model:
    """Read a PCD file; the fields `rgb` and `rgba` are packed 8-bit sRGB.

    Raises
    ------
    FileError
        pypcd4 is missing, the file is damaged or truncated, or its counts contradict each other.
    """
    pypcd4 = require(path, "pypcd4", "pcd")
    data = path.read_bytes()
    kind = "ascii" if ASCII.search(data[:MAX_HEADER]) else "binary"
    if kind == "ascii":  # pypcd4 splits a line at each blank
        data = b"\n".join(re.sub(rb"[ \t]+", b" ", line).strip() for line in data.splitlines())
    _check_header(path, data)
    notes: list[str] = []
    with foreign_errors(path, "PCD file", notes):
        cloud = pypcd4.PointCloud.from_fileobj(io.BytesIO(data))
        rows = np.atleast_1d(cloud.pc_data)
        head = cloud.metadata
    if head.width * head.height != head.points or len(rows) != head.points:
        raise FileError(
            f"{path}: has WIDTH {head.width}, HEIGHT {head.height} and POINTS {head.points}, but {len(rows)} points; "
            "the header is wrong or the file is truncated"
        )
    columns = {name.lower(): rows[name] for name in rows.dtype.names or ()}
    missing = [name for name in "xyz" if name not in columns]
    if missing:
        raise FileError(f"{path}: has no field {missing[0]}; its FIELDS are {' '.join(columns)}")
    if tuple(head.viewpoint) != (0, 0, 0, 1, 0, 0, 0):
        notes.append("ignored VIEWPOINT: points are not transformed")
    normals = stack_columns(columns, NORMAL)
    packed = next((name for name in ("rgb", "rgba") if name in columns), None)
    used = {*XYZ, packed, *(NORMAL if normals is not None else ())}
    ignored = [name for name in columns if name not in used and not name.startswith("#")]
    if ignored:
        notes.append(f"ignored {', '.join(ignored)}")
    color = None if packed is None else linear_color(_unpack(path, packed, columns[packed]), notes)
    return Model(path, f"PCD ({kind})", stack_columns(columns, XYZ), normals, color, notes=tuple(notes))


def _check_header(path: Path, data: bytes) -> None:
    """Raise `FileError` if a count exceeds the file's bytes, before pypcd4 allocates memory for it."""
    for found in re.finditer(rb"^(COUNT|POINTS|SIZE)[ \t]+([^\r\n]*)", data[:MAX_HEADER], re.MULTILINE):
        numbers = [int(word) for word in found.group(2).split() if word.isdigit()]
        if max(numbers, default=0) > len(data):
            raise FileError(
                f"{path}: {found.group(1).decode()} is {max(numbers)}, but the file has only {len(data)} bytes; it is "
                "damaged or truncated"
            )
    _check_end(path, data)


def _check_end(path: Path, data: bytes) -> None:
    """Raise `FileError` if the file ends before its last point."""
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
                "missing; the file is truncated"
            )
        return
    need = points * sum(size * count for size, count in zip(sizes, counts, strict=False))
    if kind == b"binary_compressed":
        need = 8 + int.from_bytes(data[start : start + 4], "little")
    if len(data) - start < need:
        raise FileError(
            f"{path}: the data of its {points} points take {need} bytes from byte {start} on: "
            f"{need - len(data) + start} are missing; the file is truncated"
        )


def _unpack(path: Path, name: str, column: NDArray[Any]) -> NDArray[np.uint8]:
    """Unpack (N,) colors 0xRRGGBB in 4 bytes of any type to (N, 3) bytes."""
    if column.dtype.itemsize != 4:
        raise FileError(f"{path}: field {name} has {column.dtype.itemsize} bytes; a packed color must have 4")
    bits = np.ascontiguousarray(column).view(np.uint32)
    return (np.stack([bits >> 16, bits >> 8, bits], axis=1) & 255).astype(np.uint8)
