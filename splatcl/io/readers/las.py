"""LAS and LAZ surveys, read through laspy."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import BinaryIO

import numpy as np

from splatcl.errors import FileError
from splatcl.io.readers.color import linear_integers
from splatcl.io.readers.model import RGB, Model, foreign_errors, require

MAX_PACKING = 1000
"""Largest plausible number of compressed points in a byte: a larger count is damaged."""


def read_las(path: Path) -> Model:
    """Read a LAS or LAZ file: float64 coordinates, 16-bit sRGB colors.

    Many writers store 8-bit colors in the 16-bit fields. Colors count as 8-bit if no value is above 255.

    Raises
    ------
    FileError
        laspy is missing, the file is damaged or truncated, or it has no points.
    """
    laspy = require(path, "laspy", "las")
    _check_header(path)
    notes: list[str] = []
    with foreign_errors(path, f"{path.suffix.lstrip('.').upper()} file", notes):
        # At a damaged chunk the parallel decompressor can abort the process; this one raises.
        survey = laspy.read(path, laz_backend=laspy.LazBackend.Lazrs)
        points = np.array(survey.xyz, np.float64)
        announced = survey.header.point_count
        present = set(survey.point_format.dimension_names)
        color = np.stack([survey[name] for name in RGB], axis=1) if present.issuperset(RGB) else None
        head = survey.header
        kind = f"{path.suffix.lstrip('.').upper()} {head.version}, point format {head.point_format.id}"
    if len(points) != announced:
        raise FileError(f"{path}: announces {announced} points but has {len(points)}; the file is truncated")
    if color is not None and not color.any():
        notes.append("ignored colors: all are zero")
        color = None
    if color is not None:
        eight = color.max() <= 255
        if eight:
            notes.append("took colors as 8-bit values in 16-bit fields")
        color = linear_integers(color, 255 if eight else 65535)
    return Model(path, kind, points, color=color, notes=tuple(notes))


def _check_header(path: Path) -> None:
    """Raise `FileError` if a block of the header lies past the end of the file; laspy would read on for hours."""
    size = path.stat().st_size
    with path.open("rb") as stream:
        head = stream.read(375)
        num_chunks = _num_chunks(stream, head, size)
    if head[:4] != b"LASF" or len(head) < 227:
        raise FileError(f"{path}: has no LAS header (LASF and 227 bytes)")
    header_size, data_start, num_records = struct.unpack_from("<HII", head, 94)
    if header_size + 54 * num_records > data_start or data_start > size:
        raise FileError(
            f"{path}: byte 96: the header puts points at byte {data_start}, after {num_records} records, but the "
            f"file has {size} bytes; it is damaged or truncated"
        )
    if head[25] >= 4 and len(head) >= 247:
        start, num_extended = struct.unpack_from("<QI", head, 235)
        if start + 60 * num_extended > size:
            raise FileError(
                f"{path}: byte 235 announces {num_extended} extended records, but the file has {size} bytes; it is "
                "damaged or truncated"
            )
    (length, num_points) = struct.unpack_from("<HI", head, 105)
    if head[25] >= 4 and len(head) >= 255:
        num_points = max(num_points, int.from_bytes(head[247:255], "little"))
    compressed = head[104] & 0x80
    if num_chunks > size or num_points * (1 / MAX_PACKING if compressed else length) > size - data_start:
        raise FileError(
            f"{path}: byte 105 announces {num_points} points of {length} bytes, but the file has {size}; it is "
            "damaged or truncated"
        )


def _num_chunks(stream: BinaryIO, head: bytes, size: int) -> int:
    """Return the number of chunks that a LAZ file announces; lazrs aborts the process if memory for them lacks."""
    if len(head) < 227 or not head[104] & 0x80:
        return 0
    stream.seek(int.from_bytes(head[96:100], "little"))
    table = int.from_bytes(stream.read(8), "little", signed=True)
    if table < 0:  # the file was written to a stream, so its last bytes hold the offset
        stream.seek(max(size - 8, 0))
        table = int.from_bytes(stream.read(8), "little", signed=True)
    stream.seek(min(max(table, 0), size))
    return int.from_bytes(stream.read(8)[4:], "little")
