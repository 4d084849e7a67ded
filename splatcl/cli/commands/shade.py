"""``splatcl shade``: a rendered OpenEXR file in, the same frame with new colors out."""

from __future__ import annotations

import time as clock
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from splatcl.cli.options.device import AllowInexactOption, DeviceOption
from splatcl.cli.options.groups import FILES, SETTINGS
from splatcl.cli.options.light import LightOption, light_changes
from splatcl.cli.options.outputs import (
    ExposureOption,
    OutputOption,
    PngOption,
    check_outputs,
    save_images,
    seconds_since,
)
from splatcl.cli.options.user_shader import UserShaderOption, user_shader_changes
from splatcl.scene.lights import Material, Npr, Vector
from splatcl.scene.settings import Shader
from splatcl.util.progress import stage

if TYPE_CHECKING:
    from splatcl.frame import Frame


@dataclass(frozen=True)
class MaterialChanges:
    """Phong coefficients to change."""

    ambient: float | None = None
    diffuse: float | None = None
    specular: float | None = None
    shininess: float | None = None


@dataclass(frozen=True)
class NprChanges:
    """Parameters of the npr shader to change."""

    tones: tuple[float, ...] | None = None
    contour: float | Literal["auto"] | None = None
    silhouette: float | None = None
    line: Vector | None = None


# The help of an option is that of the field.
MaterialChanges.__doc__, NprChanges.__doc__ = Material.__doc__, Npr.__doc__


def shade(
    frame: Annotated[Path, Parameter(group=FILES)],
    /,
    *,
    output: OutputOption = None,
    png: PngOption = None,
    exposure: ExposureOption = 0.0,
    shader: Annotated[Shader | None, Parameter(group=SETTINGS)] = None,
    user_shader: UserShaderOption = None,
    material: Annotated[MaterialChanges | None, Parameter(group=SETTINGS)] = None,
    npr: Annotated[NprChanges | None, Parameter(group=SETTINGS)] = None,
    time: Annotated[float | None, Parameter(group=SETTINGS)] = None,
    light: LightOption = None,
    device: DeviceOption = None,
    allow_inexact: AllowInexactOption = False,
) -> None:
    """Shade a rendered .exr again, without its splats.

    Parameters
    ----------
    frame : path
        .exr file that splatcl wrote.
    shader : str
        Color of a pixel (docs/guide/shaders.md has a picture of each).
    time : float
        Time for a user's shader, seconds.
    """
    import splatcl

    outputs = check_outputs(output, png, exposure)
    before = splatcl.read_frame(frame)
    changes = _changes(before, material=material, npr=npr, shader=shader, time=time)
    changes |= light_changes(light) | user_shader_changes(user_shader, shader)
    renderer = splatcl.Renderer(device=device, allow_inexact=allow_inexact)
    start = clock.perf_counter()
    with stage("Shading"):
        after = before.shade(renderer=renderer, **changes)
    print(f"shaded {after.width}x{after.height} with {after.settings.shader} in {seconds_since(start)}")
    save_images(after, outputs, exposure)


def _changes(frame: Frame, **given: Any) -> dict[str, Any]:
    """Return the given settings; material and npr keep the frame's values of the parts that are not given."""
    changes = {name: value for name, value in given.items() if value is not None}
    for name in {"material", "npr"} & set(changes):
        parts = {part: value for part, value in asdict(changes[name]).items() if value is not None}
        changes[name] = replace(getattr(frame.settings, name), **parts)
    return changes
