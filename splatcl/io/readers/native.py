"""splatcl's own files: whole splats without loss, as a PLY that others can open or as NPZ."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splatcl.errors import FileError
from splatcl.io.readers.model import Model, foreign_errors
from splatcl.scene.splats import OPTIONAL, PREFIX

GROUPS = {
    "center": ("x", "y", "z"),
    "tangent_u": ("tu_x", "tu_y", "tu_z"),
    "tangent_v": ("tv_x", "tv_y", "tv_z"),
    "color": ("red", "green", "blue"),
}
FURTHER = {
    "normal_du": ("ndu_x", "ndu_y", "ndu_z"),
    "normal_dv": ("ndv_x", "ndv_y", "ndv_z"),
    "clip": tuple(f"clip{line}_{term}" for line in (0, 1) for term in "uv1"),
}
"""Properties of the optional arrays; an attribute's is attribute_NAME."""
COLUMNS = frozenset(name for names in GROUPS.values() for name in names)
COLUMN = "attribute_"
COMMENT = "splatcl"
"""Begins the header comment; a JSON object of what is not in the arrays follows."""


def from_columns(path: Path, kind: str, columns: dict[str, NDArray[Any]], comments: list[str]) -> Model:
    """Return the splats of a PLY's columns; without our comment they are taken as oriented."""
    arrays = {group: np.stack([columns[n] for n in names], axis=1) for group, names in GROUPS.items()}
    for group, names in FURTHER.items():
        given = [name for name in names if name in columns]
        if given and len(given) < len(names):
            lacking = next(name for name in names if name not in columns)
            raise FileError(f"{path}: has property {given[0]} but no {lacking}; {group} needs {' '.join(names)}")
        if given:
            array = np.stack([columns[name] for name in names], axis=1)
            arrays[group] = array.reshape(-1, *OPTIONAL[group])
    arrays |= {PREFIX + n.removeprefix(COLUMN): c for n, c in columns.items() if n.startswith(COLUMN)}
    words = [comment.partition(" ") for comment in comments]
    text = next((rest for first, _, rest in words if first == COMMENT and rest.startswith("{")), "{}")
    return _model(path, f"{kind[:-1]}, splatcl)", arrays, text)


def read_npz(path: Path) -> Model:
    """Read the NPZ that `write` writes.

    Raises
    ------
    FileError
        Damaged, or arrays are missing.
    """
    with foreign_errors(path, "NPZ file", []), path.open("rb") as stream, np.load(stream) as archive:
        missing = [name for name in GROUPS if name not in archive]
        if missing:
            have = " ".join(", ".join(archive).split())
            raise FileError(f"{path}: has no array {missing[0]}; it needs {', '.join(GROUPS)} (and has {have})")
        arrays = {n: archive[n] for n in archive if n in GROUPS or n in OPTIONAL or n.startswith(PREFIX)}
        text = str(archive["splatcl"]) if "splatcl" in archive else "{}"
    for name, array in arrays.items():
        size = () if name.startswith(PREFIX) else OPTIONAL.get(name, (3,))
        if array.dtype.kind not in "fiu" or array.ndim != 1 + len(size) or array.shape[1:] != size:
            shape = f"(N{''.join(f', {n}' for n in size)})"
            raise FileError(f"{path}: array {name} is {array.dtype} of shape {array.shape}; it must be floats, {shape}")
        if len(array) != len(arrays["center"]):
            raise FileError(f"{path}: array {name} has {len(array)} rows but center has {len(arrays['center'])}")
    return _model(path, "NPZ (splatcl)", arrays, text)


def _model(path: Path, kind: str, arrays: dict[str, NDArray[Any]], text: str) -> Model:
    try:
        extra = json.loads(text)
        oriented, num_dropped = bool(extra.get("oriented", True)), int(extra.get("num_dropped", 0))
        notes = tuple(str(note) for note in extra.get("notes", ()))
    except (ValueError, TypeError, AttributeError, RecursionError):
        raise FileError(f"{path}: the splatcl comment in its header is damaged: {text[:80]!r}") from None
    return Model(
        path,
        kind,
        arrays["center"],
        color=arrays["color"],
        tangents=(arrays["tangent_u"], arrays["tangent_v"]),
        oriented=oriented,
        num_dropped=num_dropped,
        notes=notes,
        further={name: array for name, array in arrays.items() if name not in GROUPS},
    )
