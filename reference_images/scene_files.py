"""Read and write a reference image's files: NAME.json (camera and settings), NAME.npz (splats), NAME.exr, NAME.png."""

from __future__ import annotations

import dataclasses
import json
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, get_args, get_type_hints

from splatcl import Camera, Frame, RenderSettings, Splats, read, write
from splatcl.io.cameras import camera_from_json, camera_to_json
from splatcl.util.atomic import atomic_path


@dataclass(frozen=True, eq=False)
class Scene:
    """The input of a reference image, and the record of its making.

    Parameters
    ----------
    about : str
        Sentences for README.md: the image, and the rules that it pins.
    splats : Splats
    camera : Camera
    settings : RenderSettings
    made : dict
        Versions, the device, and the comparison with the oracle.
    """

    about: str
    splats: Splats
    camera: Camera
    settings: RenderSettings
    made: dict[str, Any] = field(default_factory=dict)


def scene_names(folder: Path) -> list[str]:
    """Return the names of the scenes in `folder`."""
    return sorted(path.stem for path in folder.glob("*.json"))


def read_scene(folder: Path, name: str) -> Scene:
    """Read NAME.json and its file of splats."""
    path = folder / f"{name}.json"
    values = json.loads(path.read_text(encoding="utf-8"))
    return Scene(
        values["about"],
        read(folder / values["splats"]),
        camera_from_json(values["camera"], str(path)),
        _from_json(RenderSettings, values["settings"]),
        values["made"],
    )


def write_scene(folder: Path, name: str, scene: Scene, frame: Frame) -> None:
    """Write a scene's four files. The same scene and frame give the same bytes."""
    write(scene.splats, folder / f"{name}.npz")
    frame.save(folder / f"{name}.exr")
    frame.save(folder / f"{name}.png")
    values = {
        "about": scene.about,
        "splats": f"{name}.npz",
        "camera": camera_to_json(scene.camera),
        "settings": dataclasses.asdict(scene.settings),
        "made": scene.made,
    }
    text = json.dumps(values, indent=2, allow_nan=False)
    innermost = re.compile(r"\[\s+([^][{}]*?)\s+\]")  # one line for each row of a matrix and each color
    text = innermost.sub(lambda match: "[" + re.sub(r"\s+", " ", match[1]) + "]", text)
    with atomic_path(folder / f"{name}.json") as temporary:
        temporary.write_text(text + "\n", encoding="utf-8")


def _from_json(kind: Any, value: Any) -> Any:
    """Return `value` as `kind`, with dataclasses from objects and tuples from lists, by their type hints."""
    if dataclasses.is_dataclass(kind):
        hints = get_type_hints(kind)
        return kind(**{name: _from_json(hints[name], item) for name, item in value.items()})  # type: ignore[operator]
    if isinstance(value, list):
        return tuple(_from_json(get_args(kind)[0], item) for item in value)
    return value
