"""write: splats as a native PLY that other programs can open, or as NPZ, without loss."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from splatcl.errors import FileError
from splatcl.io.readers.native import COLUMN, COMMENT, FURTHER, GROUPS
from splatcl.scene.splats import PREFIX, Splats
from splatcl.util.atomic import atomic_path, check_writable


def write(splats: Splats, path: str | os.PathLike[str]) -> None:
    """Write splats so that `read` gives them back exactly.

    Parameters
    ----------
    splats : Splats
    path : path ending in .ply or .npz
        Appears whole or not at all (`atomic_path`). The same splats give the same bytes.

    Raises
    ------
    FileError
        Another extension, or the file cannot be written.
    """
    writer = _writer(Path(path))
    with atomic_path(path) as temporary, temporary.open("wb") as stream:
        writer(splats, stream)


def check_output(path: Path) -> None:
    """Raise `FileError` now if `write` could not write splats at `path`."""
    _writer(path)
    check_writable(path)


def _writer(path: Path) -> Callable[[Splats, Any], None]:
    writers = {".ply": _write_ply, ".npz": _write_npz}
    writer = writers.get(path.suffix.lower())
    if writer is None:
        raise FileError(f"{path}: splats are written as .ply or .npz, not {path.suffix or 'without an extension'}")
    return writer


def _extra(splats: Splats) -> str:
    extra = {"oriented": splats.oriented, "num_dropped": splats.num_dropped, "notes": list(splats.notes)}
    return json.dumps({"version": 1, **extra})


def _write_ply(splats: Splats, stream: Any) -> None:
    from plyfile import PlyData, PlyElement

    columns = {name: getattr(splats, group)[:, k] for group, names in GROUPS.items() for k, name in enumerate(names)}
    for group, array in splats.optional.items():
        names = FURTHER.get(group, (COLUMN + group.removeprefix(PREFIX),))
        columns |= dict(zip(names, array.reshape(len(splats), len(names)).T, strict=True))
    rows = np.empty(len(splats), [(name, column.dtype) for name, column in columns.items()])
    for name, column in columns.items():
        rows[name] = column
    vertex = PlyElement.describe(rows, "vertex")
    PlyData([vertex], byte_order="<", comments=[f"{COMMENT} {_extra(splats)}"]).write(stream)


def _write_npz(splats: Splats, stream: Any) -> None:
    arrays = {group: getattr(splats, group) for group in GROUPS} | splats.optional
    np.savez(stream, **arrays, splatcl=np.array(_extra(splats)))
