"""A frame as one OpenEXR file: AOVs as channels, the camera as standard attributes, the rest as a JSON string."""

from __future__ import annotations

import dataclasses
import errno
import json
import math
import os
from collections.abc import Iterator, Mapping
from functools import cache
from importlib.metadata import version
from pathlib import Path
from types import NoneType
from typing import Any, get_args, get_type_hints

import numpy as np
from numpy.typing import NDArray

from splatcl.errors import FileError, SplatclError
from splatcl.io.cameras import camera_from_json, camera_to_json
from splatcl.scene.camera import Camera
from splatcl.scene.settings import RenderSettings
from splatcl.util.atomic import atomic_path

MULTI_CHANNEL = {
    "color": ("R", "G", "B", "A"),
    "P": ("P.X", "P.Y", "P.Z"),
    "N": ("N.X", "N.Y", "N.Z"),
    "albedo": ("albedo.R", "albedo.G", "albedo.B"),
    **{f"albedo.{end}": tuple(f"albedo.{end}.{c}" for c in "RGB") for end in ("lo", "hi")},
    **{f"N.{end}": tuple(f"N.{end}.{c}" for c in "XYZ") for end in ("lo", "hi")},
}
"""Channels of the AOVs with several; any other AOV is one channel with the AOV's name."""

ATTRIBUTE = "splatcl"
"""Name of the string attribute with the JSON."""

EXR_MAGIC = b"\x76\x2f\x31\x01"
"""First bytes of an OpenEXR file."""


def write_exr(
    path: str | os.PathLike[str],
    aovs: Mapping[str, NDArray[Any]],
    camera: Camera,
    settings: RenderSettings,
    metadata: Mapping[str, Any],
) -> None:
    """Write every AOV of a frame to one multi-channel OpenEXR file (lossless ZIP).

    Floating-point AOVs become FLOAT channels, integer AOVs become UINT channels. Equal frames give equal bytes.

    Parameters
    ----------
    path : path
    aovs : mapping of str to array
        (H, W) or (H, W, C) by name.
    camera : Camera
    settings : RenderSettings
    metadata : mapping
        Further facts to record (JSON's types or NumPy numbers).

    Raises
    ------
    FileError
        The file cannot be written; an existing file is unchanged.
    SplatclError
        The shape of an AOV differs from the image's size or its number of channels.
    """
    import OpenEXR

    channels = {name: plane for aov in aovs for name, plane in _planes(aov, aovs[aov], camera)}
    header = {
        "compression": OpenEXR.ZIP_COMPRESSION,
        "type": OpenEXR.scanlineimage,
        "worldToCamera": world_to_camera(camera),
        "worldToNDC": world_to_ndc(camera),
        ATTRIBUTE: _describe(camera, settings, metadata),
    }
    with atomic_path(path) as temporary:
        try:
            # A Python file, because OpenEXR's own one loses a write error in its last buffer (a full disk).
            with temporary.open("wb") as file:
                _use_all_cores()
                OpenEXR.File(header, channels).write(file)
        except RuntimeError as error:
            raise OSError(errno.EIO, str(error)) from None


def read_exr(path: str | os.PathLike[str]) -> tuple[dict[str, NDArray[Any]], Camera | None, dict[str, Any]]:
    """Read an OpenEXR file.

    Returns
    -------
    aovs : dict of (H, W) or (H, W, C) float32, float16 or uint32 array
        AOVs by name; a channel that belongs to no known AOV becomes an AOV.
    camera : Camera or None
        Exactly the camera that was written; None for a file of another program.
    metadata : dict
        The frame's metadata, "settings" and "versions"; empty for a file of another program.

    Raises
    ------
    FileError
        The file is missing or damaged, or is not OpenEXR.
    """
    import OpenEXR

    try:
        with Path(path).open("rb") as file:
            if file.read(4) != EXR_MAGIC:
                raise FileError(f"{path}: not an OpenEXR file")
            file.seek(0)
            image = OpenEXR.File(file, separate_channels=True)
            planes = {name: channel.pixels for name, channel in image.channels().items()}
            text = image.header().get(ATTRIBUTE, "{}")
        description = json.loads(text)
        if not isinstance(description, dict):
            raise FileError(f"{path}: its attribute {ATTRIBUTE} must be a JSON object")
    except OSError as error:
        raise FileError(f"{path}: cannot read: {error.strerror or error}") from error
    except FileError:
        raise
    except (RuntimeError, ValueError) as error:  # OpenEXR drops parts that it cannot decode
        raise FileError(f"{path}: damaged or unsupported OpenEXR file ({error})") from None
    camera = description.pop("camera", None)
    return _group(planes), camera and camera_from_json(camera, os.fspath(path)), description


def _use_all_cores() -> None:
    """Set OpenEXR's number of threads to the number of cores, unless the program has set one."""
    import OpenEXR

    if not OpenEXR.global_thread_count():
        OpenEXR.set_global_thread_count(os.cpu_count())
        _end_threads_before_fork()


@cache
def _end_threads_before_fork() -> None:
    """Register, once, that OpenEXR's threads end before a fork: the child would wait for them forever."""
    import OpenEXR

    os.register_at_fork(before=lambda: OpenEXR.set_global_thread_count(0))


def world_to_camera(camera: Camera) -> NDArray[np.float32]:
    """Return OpenEXR's worldToCamera.

    Returns
    -------
    (4, 4) float32
        Acts on row vectors (p' = p M): world space to x right, y up, z forward (left-handed), scene units.
    """
    return _row_vector_matrix(np.diag([1.0, -1.0, 1.0, 1.0]) @ camera.eye_from_world)


def world_to_ndc(camera: Camera) -> NDArray[np.float32]:
    """Return OpenEXR's worldToNDC.

    Returns
    -------
    (4, 4) float32
        Acts on row vectors: world space to (x, y, z, w), where (x/w, y/w) is (0, 0) at the image's upper left corner
        and (1, 1) at its lower right corner. The standard leaves z open. Here z/w is 1/Z of eye space for a
        perspective camera and Z for an orthographic one, so that the matrix can be inverted.
    """
    x, y = camera.fx / camera.width, camera.fy / camera.height
    center_x, center_y = camera.cx / camera.width, camera.cy / camera.height
    if camera.projection == "perspective":
        ndc_from_eye = [[x, 0, center_x, 0], [0, y, center_y, 0], [0, 0, 0, 1], [0, 0, 1, 0]]
    else:
        ndc_from_eye = [[x, 0, 0, center_x], [0, y, 0, center_y], [0, 0, 1, 0], [0, 0, 0, 1]]
    return _row_vector_matrix(np.array(ndc_from_eye) @ camera.eye_from_world)


def _row_vector_matrix(matrix: NDArray[np.float64]) -> NDArray[np.float32]:
    """Transpose a matrix that acts on column vectors."""
    return np.ascontiguousarray(matrix.T, dtype=np.float32)


def _planes(aov: str, values: NDArray[Any], camera: Camera) -> Iterator[tuple[str, NDArray[Any]]]:
    """Yield the name and the (H, W) pixels of each channel of an AOV; OpenEXR needs contiguous float32 or uint32."""
    pixels = np.asarray(values)
    names = MULTI_CHANNEL.get(aov)
    size = (camera.height, camera.width)
    expected = (*size, len(names)) if names else size
    if pixels.shape != expected:
        raise SplatclError(f"AOV {aov} has shape {pixels.shape}; it must be {expected}")
    dtype = np.uint32 if pixels.dtype.kind in "ui" else np.float32
    if not names:
        yield aov, np.ascontiguousarray(pixels, dtype=dtype)
    for i, name in enumerate(names or ()):
        yield name, np.ascontiguousarray(pixels[..., i], dtype=dtype)


def _group(planes: dict[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Stack the channels of each AOV in `MULTI_CHANNEL`; the other channels stay as they are."""
    aovs = {}
    for aov, names in MULTI_CHANNEL.items():
        if all(name in planes for name in names):
            aovs[aov] = np.stack([planes.pop(name) for name in names], axis=-1)
    return aovs | planes


def _describe(camera: Camera, settings: RenderSettings, metadata: Mapping[str, Any]) -> str:
    """Return the JSON of the string attribute."""
    versions = {name: version(name) for name in ("splatcl", "numpy", "OpenEXR")}
    description = {
        **metadata,
        "camera": camera_to_json(camera),
        "settings": dataclasses.asdict(settings),
        "versions": {**versions, **metadata.get("versions", {})},
    }
    return json.dumps(_plain(description), sort_keys=True, allow_nan=False)


def _plain(value: Any) -> Any:
    """Convert NumPy's types and non-finite floats (to "inf", "-inf", "nan") to JSON's types."""
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, np.ndarray | np.generic):
        return _plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    return value if isinstance(value, str | int | float | None) else str(value)


def from_json(hint: Any, value: Any) -> Any:
    """Rebuild a value from its `dataclasses.asdict` form in JSON; `hint` is a dataclass or the type of a field.

    Raises
    ------
    TypeError
        The form has an unknown field, or does not fit `hint`.
    """
    options: list[Any] = [option for option in (hint, *get_args(hint)) if option not in (NoneType, Ellipsis)]
    if isinstance(value, dict):
        kind: Any = next((option for option in options if dataclasses.is_dataclass(option)), None)
        if kind is None:
            raise TypeError(f"{value!r} must be {hint}")
        hints = get_type_hints(kind)
        unknown = sorted(set(value) - set(hints))
        if unknown:
            raise TypeError(f"unknown field {unknown[0]}")
        return kind(**{name: from_json(hints[name], item) for name, item in value.items()})
    if isinstance(value, list):
        return tuple(from_json(options[-1], item) for item in value)
    return value
