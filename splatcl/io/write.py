"""write: save splats without loss, as a PLY that other programs can open, or as NPZ."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splatcl.errors import FileError
from splatcl.io.readers.native import ATTRIBUTE_COLUMN, COLUMNS_OF, COMMENT, OPTIONAL_COLUMNS_OF
from splatcl.scene.splats import PREFIX, Splats
from splatcl.util.atomic import atomic_path, check_writable


def write(splats: Splats, path: str | os.PathLike[str]) -> None:
    """Write splats to a file from which `read` returns them exactly.

    Parameters
    ----------
    splats : Splats
    path : path ending in .ply or .npz
        The file appears whole or not at all (`atomic_path`). Equal splats give equal bytes.

    Raises
    ------
    FileError
        The extension is neither .ply nor .npz, or the file cannot be written.
    """
    writer = _writer(Path(path))
    with atomic_path(path) as temporary, temporary.open("wb") as stream:
        writer(splats, stream)


def check_output(path: Path) -> None:
    """Raise `FileError` if `write` cannot write splats at `path`."""
    _writer(path)
    check_writable(path)


def _writer(path: Path) -> Callable[[Splats, Any], None]:
    writers = {".ply": _write_ply, ".npz": _write_npz}
    writer = writers.get(path.suffix.lower())
    if writer is None:
        raise FileError(f"{path}: cannot write {path.suffix or 'a file without extension'}; use .ply or .npz")
    return writer


def _fields_json(splats: Splats) -> str:
    """Return the fields that are no arrays as JSON."""
    fields = {"oriented": splats.oriented, "num_dropped": splats.num_dropped, "notes": list(splats.notes)}
    return json.dumps({"version": 1, **fields})


def _write_ply(splats: Splats, stream: Any) -> None:
    from plyfile import PlyData, PlyElement

    arrays = {name: getattr(splats, name) for name in COLUMNS_OF} | splats.optional
    columns: dict[str, NDArray[Any]] = {}
    for array_name, array in arrays.items():
        attribute = (ATTRIBUTE_COLUMN + array_name.removeprefix(PREFIX),)
        names = (COLUMNS_OF | OPTIONAL_COLUMNS_OF).get(array_name, attribute)
        columns |= dict(zip(names, array.reshape(len(splats), len(names)).T, strict=True))
    rows = np.empty(len(splats), [(name, column.dtype) for name, column in columns.items()])
    for name, column in columns.items():
        rows[name] = column
    vertex = PlyElement.describe(rows, "vertex")
    PlyData([vertex], byte_order="<", comments=[f"{COMMENT} {_fields_json(splats)}"]).write(stream)


def _write_npz(splats: Splats, stream: Any) -> None:
    arrays = {name: getattr(splats, name) for name in COLUMNS_OF} | splats.optional
    np.savez(stream, **arrays, splatcl=np.array(_fields_json(splats)))
