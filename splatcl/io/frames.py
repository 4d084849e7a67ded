"""Frames from OpenEXR files that splatcl wrote."""

from __future__ import annotations

import dataclasses
import os
from types import NoneType
from typing import Any, get_args, get_type_hints

from splatcl.errors import FileError, SettingsError
from splatcl.frame import Frame
from splatcl.io.exr import read_exr
from splatcl.scene.settings import RenderSettings


def read_frame(path: str | os.PathLike[str]) -> Frame:
    """Read a frame that splatcl wrote.

    Parameters
    ----------
    path : path
        .exr.

    Returns
    -------
    Frame
        AOVs as written (float32, uint32), camera and settings exactly, metadata as JSON has it. It has no splats, so
        it can be shaded again but not probed.

    Raises
    ------
    FileError
        The file is missing or damaged, not OpenEXR, or not from splatcl.
    SettingsError
        Its settings are of another version of splatcl.
    """
    aovs, camera, metadata = read_exr(path)
    if camera is None or "settings" not in metadata:
        raise FileError(f"{path}: splatcl did not write it: it has no camera and settings; make a Frame of its AOVs")
    try:
        settings = from_json(RenderSettings, metadata.pop("settings"))
    except (SettingsError, TypeError) as error:
        raise SettingsError(f"{path}: settings of another version of splatcl: {error}") from None
    return Frame(aovs, camera, settings, metadata)


def from_json(hint: Any, value: Any) -> Any:
    """Return a value of type `hint`, a dataclass or of what its fields may be, from what `dataclasses.asdict` wrote."""
    options: list[Any] = [option for option in (hint, *get_args(hint)) if option not in (NoneType, Ellipsis)]
    if isinstance(value, dict):
        kind: Any = next((option for option in options if dataclasses.is_dataclass(option)), None)
        if kind is None:
            raise TypeError(f"{value!r} where {hint} belongs")
        hints = get_type_hints(kind)
        unknown = sorted(set(value) - set(hints))
        if unknown:
            raise TypeError(f"no {unknown[0]}")
        return kind(**{name: from_json(hints[name], item) for name, item in value.items()})
    if isinstance(value, list):
        return tuple(from_json(options[-1], item) for item in value)
    return value
