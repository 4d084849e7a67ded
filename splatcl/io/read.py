"""read: choose a reader by a file's first bytes and extension, and make splats of the model that it returns."""

from __future__ import annotations

import importlib
import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Literal, get_args

import numpy as np

from splatcl.errors import FileError, InvalidSplatsError, SettingsError
from splatcl.io.readers.model import Model
from splatcl.scene.splats import OPTIONAL, PREFIX, OnInvalid, Splats

READERS = {
    ".ply": "ply.read_ply", ".npz": "native.read_npz", ".raw": "raw.read_raw",
    ".xyz": "text.read_text", ".xyzn": "text.read_text", ".xyzrgb": "text.read_text",
    ".pwn": "text.read_text", ".pts": "text.read_text", ".txt": "text.read_text",
    ".asc": "text.read_text", ".csv": "text.read_text",
    ".ptx": "text.read_ptx", ".pcd": "pcd.read_pcd", ".las": "las.read_las", ".laz": "las.read_las",
    ".obj": "obj.read_obj", ".off": "off.read_off", ".coff": "off.read_off", ".stl": "stl_glb.read_stl",
    ".glb": "stl_glb.read_glb",
}  # fmt: skip
"""Extension -> module and function in `splatcl.io.readers`."""
MAGIC = {b"ply\n": ".ply", b"ply\r": ".ply", b"LASF": ".las", b"glTF": ".glb", b"PK\x03\x04": ".npz"}
"""First four bytes of a file -> the extension of its type."""
Z_UP = (".las", ".laz", ".ptx")
"""Extensions of surveys: z points up."""


def read(path: str | os.PathLike[str], on_invalid: OnInvalid = "error") -> Splats:
    """Read a file and make splats of it.

    Parameters
    ----------
    path : path
        PLY, NPZ, XYZ, PWN, PTS, PTX, TXT, CSV, PCD, OBJ, OFF, STL, GLB, LAS, LAZ or glviz RAW.
    on_invalid : {"error", "drop"}
        Treatment of unusable points, triangles or splats; a note counts the dropped ones.

    Returns
    -------
    Splats
        The splats of the file, or splats that cover its triangles, or splats estimated from its points.

    Raises
    ------
    FileError
        The file cannot be read; the message starts with its path and names the place and the remedy.
    InvalidSplatsError
        Points, triangles or splats are unusable under ``on_invalid="error"``, or none is usable.
    SettingsError
        `on_invalid` has an unknown value.
    """
    if on_invalid not in get_args(OnInvalid):
        raise SettingsError(f"on_invalid {on_invalid!r} must be 'error' or 'drop'")
    model = load_model(path)
    try:
        return _splats(model, on_invalid)
    except InvalidSplatsError as error:
        raise InvalidSplatsError(f"{model.path}: {error}") from None


def up_axis(path: str | os.PathLike[str]) -> Literal["y", "-y", "z"]:
    """Return the axis that points up by the convention of the file's type.

    It is z for surveys, -y for Gaussians (COLMAP's cameras have y down), and y for all other types.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    with suppress(OSError), path.open("rb") as stream:
        suffix = _kind(path, stream.read(16))
    if suffix == ".ply" and path.is_file():
        from splatcl.io.readers import gaussians, native, ply

        names = ply.property_names(path)
        return "-y" if names >= gaussians.COLUMNS and not names >= native.COLUMNS else "y"
    return "z" if suffix in Z_UP else "y"


def _kind(path: Path, head: bytes) -> str:
    """Return the extension of a file's type, from its first bytes if they identify the type."""
    suffix = path.suffix.lower()
    return suffix if suffix in (".las", ".laz") else MAGIC.get(head[:4], suffix)


def _splats(model: Model, on_invalid: OnInvalid) -> Splats:
    """Make splats of a model; the errors are those of `read`, without the path."""
    if model.tangents is not None:
        optional = {name: array for name, array in model.optional.items() if name in OPTIONAL}
        named = {n.removeprefix(PREFIX): array for n, array in model.optional.items() if n.startswith(PREFIX)}
        return Splats(
            model.points,
            *model.tangents,
            model.color,  # type: ignore[arg-type]
            oriented=model.oriented,
            num_dropped=model.num_dropped,
            notes=model.notes,
            on_invalid=on_invalid,
            **optional,
            attributes=named,
        )
    if model.faces is not None and len(model.faces):
        from splatcl.prepare.meshes import splats_from_mesh

        return mesh_splats(model, on_invalid, splats_from_mesh)
    from splatcl.prepare.points import splats_from_points

    return splats_from_points(
        model.points, model.normals, model.color, model.radius, on_invalid=on_invalid, notes=model.notes
    )


def mesh_splats(model: Model, on_invalid: OnInvalid, make: Callable[..., Splats]) -> Splats:
    """Make splats of a model's triangles by `make`, a function with the parameters of `splats_from_mesh`."""
    unused = len(model.points) - len(np.unique(np.asarray(model.faces)))
    per_face = model.face_color is not None
    return make(
        model.points,
        model.faces,
        model.face_color if per_face else model.color,
        model.normals,
        per_face=per_face,
        on_invalid=on_invalid,
        notes=[*model.notes, *([f"dropped {unused} vertices without a face"] if unused else [])],
    )


def load_model(path: str | os.PathLike[str]) -> Model:
    """Read a file with the reader of its type; the type follows from the first bytes or the extension.

    Raises
    ------
    FileError
        The file cannot be read, or its type is unknown.
    """
    path = Path(path)
    try:
        if path.is_dir():
            raise FileError(f"{path}: is a folder; give a file in it")
        with path.open("rb") as stream:
            head = stream.read(16)
        if not head:
            raise FileError(f"{path}: is empty")
        suffix = _kind(path, head)
        if suffix not in READERS:
            known = " ".join(sorted(name.lstrip(".") for name in READERS))
            raise FileError(f"{path}: unknown file type {suffix or 'without an extension'}; it must be one of {known}")
        module, function = READERS[suffix].split(".")
        reader: Callable[[Path], Model] = getattr(importlib.import_module(f"splatcl.io.readers.{module}"), function)
        return reader(path)
    except OSError as error:
        raise FileError(f"{path}: cannot read: {error.strerror or error}") from error
    except MemoryError as error:
        raise FileError(f"{path}: cannot read: out of memory") from error
