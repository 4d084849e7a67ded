"""The .raw meshes of the GLSL viewer glviz: little-endian counts, float vertices, triangle indices."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from splatcl.errors import FileError
from splatcl.io.readers.model import Model


def read_raw(path: Path) -> Model:
    """Read a .raw mesh: u32 V, V x 3 f32 vertices, u32 F, F x 3 u32 indices.

    Raises
    ------
    FileError
        The counts do not fit the file's size; the message names the byte.
    """
    data = path.read_bytes()
    vertices, end = _block(path, data, 0, "<f4", "vertices")
    faces, end = _block(path, data, end, "<u4", "faces")
    if end != len(data):
        raise FileError(f"{path}: {len(data) - end} bytes follow its faces at byte {end}; it must be a glviz .raw mesh")
    return Model(path, "RAW (glviz mesh)", vertices.astype(np.float32), faces=faces.astype(np.int64))


def _block(path: Path, data: bytes, start: int, dtype: str, noun: str) -> tuple[np.ndarray, int]:
    """Read a count at byte `start` and its (N, 3) rows; return the rows and the byte after them."""
    num = int.from_bytes(data[start : start + 4], "little")
    end = start + 4 + 12 * num
    if end > len(data) or len(data) < start + 4:
        raise FileError(
            f"{path}: byte {start} announces {num} {noun}, but the file ends at byte {len(data)}; it is truncated, or "
            "no glviz .raw mesh"
        )
    return np.frombuffer(data, dtype, 3 * num, start + 4).reshape(num, 3), end
