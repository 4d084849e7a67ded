"""LAS and LAZ surveys through laspy."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import BinaryIO

import numpy as np

from splatcl.errors import FileError
from splatcl.io.readers.color import linear_integers
from splatcl.io.readers.model import Model, foreign_errors, require

MAX_PACKING = 1000
"""More compressed points than this in a byte are a damaged count."""
RGB = ("red", "green", "blue")


def read_las(path: Path) -> Model:
    """Read a LAS or LAZ file: float64 coordinates, 16-bit sRGB colors.

    Many writers put 8-bit colors into the 16-bit fields; where no value is above 255 they are taken as such.

    Raises
    ------
    FileError
        laspy is missing, the file is damaged or cut, or has no points.
    """
    laspy = require(path, "laspy", "las")
    _check_header(path)
    notes: list[str] = []
    with foreign_errors(path, f"{path.suffix.lstrip('.').upper()} file", notes):
        # The parallel decompressor can abort the whole process at a damaged chunk; this one raises.
        survey = laspy.read(path, laz_backend=laspy.LazBackend.Lazrs)
        points = np.array(survey.xyz, np.float64)
        announced = survey.header.point_count
        present = set(survey.point_format.dimension_names)
        color = np.stack([survey[name] for name in RGB], axis=1) if present.issuperset(RGB) else None
        head = survey.header
        kind = f"{path.suffix.lstrip('.').upper()} {head.version}, point format {head.point_format.id}"
    if len(points) != announced:
        raise FileError(f"{path}: announces {announced} points but has {len(points)}; it was cut")
    if color is not None and not color.any():
        notes.append("ignored colors: all are zero")
        color = None
    if color is not None:
        eight = color.max() <= 255
        if eight:
            notes.append("colors are 8-bit values in 16-bit fields")
        color = linear_integers(color, 255 if eight else 65535)
    return Model(path, kind, points, color=color, notes=tuple(notes))


def _check_header(path: Path) -> None:
    """Refuse a header whose blocks cannot be in the file; laspy would read on past its end for hours."""
    size = path.stat().st_size
    with path.open("rb") as stream:
        head = stream.read(375)
        num_chunks = _num_chunks(stream, head, size)
    if head[:4] != b"LASF" or len(head) < 227:
        raise FileError(f"{path}: does not begin with a LAS header (LASF and 227 bytes)")
    header_size, data_start, num_records = struct.unpack_from("<HII", head, 94)
    if header_size + 54 * num_records > data_start or data_start > size:
        raise FileError(
            f"{path}: byte 96: the header puts points at byte {data_start}, after {num_records} records, in a file "
            f"of {size} bytes; it is damaged or was cut"
        )
    if head[25] >= 4 and len(head) >= 247:
        start, num_extended = struct.unpack_from("<QI", head, 235)
        if start + 60 * num_extended > size:
            raise FileError(f"{path}: byte 235: {num_extended} extended records do not fit its {size} bytes")
    (length, num_points) = struct.unpack_from("<HI", head, 105)
    if head[25] >= 4 and len(head) >= 255:
        num_points = max(num_points, int.from_bytes(head[247:255], "little"))
    compressed = head[104] & 0x80
    if num_chunks > size or num_points * (1 / MAX_PACKING if compressed else length) > size - data_start:
        raise FileError(
            f"{path}: byte 105: announces {num_points} points of {length} bytes, but the file has {size}; it is "
            "damaged or was cut"
        )


def _num_chunks(stream: BinaryIO, head: bytes, size: int) -> int:
    """Return how many chunks a LAZ file announces: lazrs aborts the process where memory for them is lacking."""
    if len(head) < 227 or not head[104] & 0x80:
        return 0
    stream.seek(int.from_bytes(head[96:100], "little"))
    table = int.from_bytes(stream.read(8), "little", signed=True)
    if table < 0:  # written to a stream: the place is at the end instead
        stream.seek(max(size - 8, 0))
        table = int.from_bytes(stream.read(8), "little", signed=True)
    stream.seek(min(max(table, 0), size))
    return int.from_bytes(stream.read(8)[4:], "little")
