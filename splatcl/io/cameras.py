"""Camera files: JSON with intrinsics, extrinsics and the name of the eye's axes (docs/guide/cameras.md)."""

from __future__ import annotations

import json
import math
import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splatcl.errors import CameraError, FileError
from splatcl.scene.camera import Camera
from splatcl.util.atomic import atomic_path

REQUIRED = ("width", "height", "fx", "fy", "cx", "cy", "axes")
OPTIONAL = ("near", "far", "projection")
MATRICES = ("eye_from_world", "world_from_eye")
KEYS = (*REQUIRED, *OPTIONAL, *MATRICES)

EYE_FROM_AXES = {"opencv": np.diag([1.0, 1.0, 1.0, 1.0]), "opengl": np.diag([1.0, -1.0, -1.0, 1.0])}
"""(4, 4) transform from a file's eye space to splatcl's (x right, y down, z forward), by the name of the axes."""


def read_camera(path: str | os.PathLike[str]) -> Camera:
    """Read a camera file.

    Parameters
    ----------
    path : path
        A JSON file (docs/guide/cameras.md).

    Raises
    ------
    FileError
        The file cannot be read or is not JSON.
    CameraError
        A key is missing, unknown or given twice, or its value is out of range; the message names the file and the key.
    """
    try:
        text = Path(path).read_text(encoding="utf-8")
        values = json.loads(text, object_pairs_hook=lambda pairs: _unique(pairs, path))
    except OSError as error:
        raise FileError(f"{path}: cannot read: {error.strerror or error}") from error
    except CameraError:
        raise
    except (ValueError, RecursionError) as error:
        raise FileError(f"{path}: not a JSON camera file ({' '.join(str(error).split())})") from None
    return camera_from_json(values, os.fspath(path))


def write_camera(camera: Camera, path: str | os.PathLike[str]) -> None:
    """Write a camera file; `read_camera` returns exactly the same camera.

    Raises
    ------
    FileError
        The file cannot be written.
    """
    lines = [f"  {json.dumps(key)}: {_json_value(value)}" for key, value in camera_to_json(camera).items()]
    text = "{\n" + ",\n".join(lines) + "\n}\n"
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def camera_to_json(camera: Camera) -> dict[str, Any]:
    """Convert a camera to the content of a camera file: plain numbers, strings and lists."""
    values: dict[str, Any] = {
        key: getattr(camera, key) for key in ("projection", "width", "height", "fx", "fy", "cx", "cy", "near")
    }
    values["far"] = None if math.isinf(camera.far) else camera.far
    values["axes"] = "opencv"
    values["eye_from_world"] = camera.eye_from_world.tolist()
    return values


def camera_from_json(values: Any, where: str) -> Camera:
    """Make a camera of the content of a camera file.

    Parameters
    ----------
    values : object
        The result of `json.loads`.
    where : str
        Name of the file, for messages.

    Raises
    ------
    CameraError
        As for `read_camera`.
    """
    matrix_key = _check_keys(values, where)
    if values["axes"] not in tuple(EYE_FROM_AXES):
        raise CameraError(f"{where}: axes {values['axes']!r} must be 'opencv' or 'opengl'")
    matrix = _matrix(values[matrix_key], f"{where}: {matrix_key}")
    if matrix_key == "world_from_eye":
        matrix = _rigid_inverse(matrix)
    arguments = {key: _number(values[key], f"{where}: {key}") for key in REQUIRED if key != "axes"}
    if "near" in values:
        arguments["near"] = _number(values["near"], f"{where}: near")
    if values.get("far") is not None:
        arguments["far"] = _number(values["far"], f"{where}: far")
    projection = values.get("projection", "perspective")
    if not isinstance(projection, str):
        raise CameraError(f"{where}: projection {projection!r} must be a string")
    try:
        return Camera(EYE_FROM_AXES[values["axes"]] @ matrix, projection=projection, **arguments)  # type: ignore[arg-type]
    except CameraError as error:
        raise CameraError(f"{where}: {str(error).replace('eye_from_world', matrix_key)}") from None


def _unique(pairs: list[tuple[str, Any]], path: str | os.PathLike[str]) -> dict[str, Any]:
    keys = [key for key, _ in pairs]
    for key in keys:
        if keys.count(key) > 1:
            raise CameraError(f"{path}: {key} is given twice; give it once")
    return dict(pairs)


def _check_keys(values: Any, where: str) -> str:
    """Check the keys and return the one of the matrix."""
    if not isinstance(values, dict):
        raise CameraError(f"{where}: a camera file must hold one JSON object, not a {type(values).__name__}")
    for key in values:
        if key not in KEYS:
            raise CameraError(f"{where}: unknown key {key!r}; it must be one of {', '.join(KEYS)}")
    for key in REQUIRED:
        if key not in values:
            raise CameraError(f"{where}: {key} is missing; a camera file must have {', '.join(REQUIRED)}")
    given = [key for key in MATRICES if key in values]
    if len(given) != 1:
        raise CameraError(f"{where}: must have exactly one of eye_from_world and world_from_eye, not {len(given)}")
    return given[0]


def _number(value: Any, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise CameraError(f"{where} {value!r} must be a number")
    if abs(value) > 1e300 or value != value:
        raise CameraError(f"{where} must be a finite number")
    return value


def _matrix(value: Any, where: str) -> NDArray[np.float64]:
    if not isinstance(value, list) or len(value) != 4:
        raise CameraError(f"{where} must be a list of four rows")
    for row in value:
        if not isinstance(row, list) or len(row) != 4:
            raise CameraError(f"{where} must have rows of four numbers")
    return np.array([[_number(entry, where) for entry in row] for row in value], dtype=np.float64)


def _rigid_inverse(matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """Invert a (4, 4) rigid transform by transposing its rotation; `Camera` rejects any other matrix."""
    inverse = matrix.copy()
    inverse[:3, :3] = matrix[:3, :3].T
    inverse[:3, 3] = -inverse[:3, :3] @ matrix[:3, 3]
    return inverse


def _json_value(value: Any) -> str:
    if isinstance(value, list):
        rows = ",\n".join(f"    {json.dumps(row)}" for row in value)
        return f"[\n{rows}\n  ]"
    return json.dumps(value)
