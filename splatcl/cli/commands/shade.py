"""``splatcl shade``: a rendered OpenEXR file in, the same with another lighting out."""

from __future__ import annotations

import time as clock
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from splatcl.cli.commands.render import check_outputs, save
from splatcl.cli.options.light import parse_light
from splatcl.cli.options.user_shader import user_changes
from splatcl.scene.lights import Vector
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
    """What of the npr shader to change."""

    tones: tuple[float, ...] | None = None
    contour: float | Literal["auto"] | None = None
    silhouette: float | None = None
    line: Vector | None = None


def shade(
    frame: Path,
    /,
    *,
    output: Annotated[Path | None, Parameter(alias="-o")] = None,
    png: Path | None = None,
    exposure: float = 0.0,
    shader: Shader | None = None,
    user_shader: Annotated[Path | None, Parameter(parse=True)] = None,
    material: MaterialChanges | None = None,
    npr: NprChanges | None = None,
    time: float | None = None,
    light: Annotated[list[str] | None, Parameter(consume_multiple=False)] = None,
    device: str | None = None,
    allow_inexact: bool = False,
) -> None:
    """Shade a rendered .exr again, without its splats (docs/guide/shaders.md). What is not given stays as it was.

    Parameters
    ----------
    frame : path
        .exr file that splatcl wrote.
    output : path
        .exr or .png file to write.
    png : path
        .png file to write.
    exposure : float
        Stops, for the PNG.
    shader : str
        How each pixel is coloured.
    user_shader : path
        File of OpenCL C with a function float4 shade(const Surface s, const Scene scene).
    time : float
        Seconds, for a user's shader.
    light : str
        A light, such as kind=point,vector=0:2:1,color=1:1:1 (docs/guide/lights.md), in place of those of the frame;
        give the option again for each further light. Shadows need a new render.
    device : str
        OpenCL device: an index of `splatcl devices`, or words of its name and version.
    allow_inexact : bool
        Shade even where the device or the environment may change bits of the image (`splatcl doctor`); recorded.
    """
    import splatcl

    outputs = check_outputs(output, png, exposure)
    before = splatcl.read_frame(frame)
    changes = _changes(before, material=material, npr=npr, shader=shader, time=time)
    if light:
        changes["lights"] = tuple(map(parse_light, light))
    if user_shader is not None:
        changes |= user_changes(user_shader, shader)
    renderer = splatcl.Renderer(device=device, allow_inexact=allow_inexact)
    start = clock.perf_counter()
    with stage("Shading"):
        after = before.shade(renderer=renderer, **changes)
    print(f"shaded {after.width}x{after.height} with {after.settings.shader} in {clock.perf_counter() - start:.2f} s")
    save(after, outputs, exposure)


def _changes(frame: Frame, **given: Any) -> dict[str, Any]:
    """Return the settings that were given; of those with parts, the other parts are the frame's."""
    changes = {name: value for name, value in given.items() if value is not None}
    for name in {"material", "npr"} & set(changes):
        parts = {part: value for part, value in asdict(changes[name]).items() if value is not None}
        changes[name] = replace(getattr(frame.settings, name), **parts)
    return changes
