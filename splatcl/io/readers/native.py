"""Native files: whole splats without loss, as a PLY that other programs can open, or as NPZ."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splatcl.errors import FileError
from splatcl.io.readers.model import Model, foreign_errors, stack_columns
from splatcl.scene.splats import OPTIONAL, PREFIX

COLUMNS_OF = {
    "center": ("x", "y", "z"),
    "tangent_u": ("tu_x", "tu_y", "tu_z"),
    "tangent_v": ("tv_x", "tv_y", "tv_z"),
    "color": ("red", "green", "blue"),
}
"""PLY properties of the required arrays."""
OPTIONAL_COLUMNS_OF = {
    "normal_du": ("ndu_x", "ndu_y", "ndu_z"),
    "normal_dv": ("ndv_x", "ndv_y", "ndv_z"),
    "clip": tuple(f"clip{line}_{term}" for line in (0, 1) for term in "uv1"),
}
"""PLY properties of the optional arrays."""
COLUMNS = frozenset(name for names in COLUMNS_OF.values() for name in names)
"""Properties that identify a native PLY."""
ATTRIBUTE_COLUMN = "attribute_"
"""Prefix of the PLY property of an attribute."""
COMMENT = "splatcl"
"""First word of the header comment; a JSON object with the other fields of `Splats` follows."""


def from_columns(path: Path, kind: str, columns: dict[str, NDArray[Any]], comments: list[str]) -> Model:
    """Make the splats of a PLY's columns; without splatcl's comment they count as oriented."""
    arrays = {array: stack_columns(columns, names) for array, names in COLUMNS_OF.items()}
    for array, names in OPTIONAL_COLUMNS_OF.items():
        given = [name for name in names if name in columns]
        if given and len(given) < len(names):
            missing = next(name for name in names if name not in columns)
            raise FileError(f"{path}: has property {given[0]} but no {missing}; {array} needs {' '.join(names)}")
        if given:
            arrays[array] = stack_columns(columns, names).reshape(-1, *OPTIONAL[array])
    attributes = {name: column for name, column in columns.items() if name.startswith(ATTRIBUTE_COLUMN)}
    arrays |= {PREFIX + name.removeprefix(ATTRIBUTE_COLUMN): column for name, column in attributes.items()}
    words = [comment.partition(" ") for comment in comments]
    text = next((rest for first, _, rest in words if first == COMMENT and rest.startswith("{")), "{}")
    return _model(path, f"{kind[:-1]}, splatcl)", arrays, text)


def read_npz(path: Path) -> Model:
    """Read an NPZ file of `write`.

    Raises
    ------
    FileError
        The file is damaged, or an array is missing or has a wrong shape.
    """
    with foreign_errors(path, "NPZ file", []), path.open("rb") as stream, np.load(stream) as archive:
        missing = [name for name in COLUMNS_OF if name not in archive]
        if missing:
            present = " ".join(", ".join(archive).split())
            raise FileError(f"{path}: has no array {missing[0]}; it needs {', '.join(COLUMNS_OF)} (and has {present})")
        arrays = {n: archive[n] for n in archive if n in COLUMNS_OF or n in OPTIONAL or n.startswith(PREFIX)}
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
        optional={name: array for name, array in arrays.items() if name not in COLUMNS_OF},
    )
