"""``splatcl render``: a scan in, an OpenEXR file or a PNG out."""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
from cyclopts import Parameter

from splatcl.cli.options.light import with_lights
from splatcl.cli.options.user_shader import with_user_shader
from splatcl.cli.options.view import View, read_scan
from splatcl.errors import CheckError, SettingsError
from splatcl.scene.settings import RenderSettings
from splatcl.scene.splats import OnInvalid
from splatcl.util.progress import stage

if TYPE_CHECKING:
    from splatcl.frame import Frame

MAX_SAMPLES = 1_000_000
"""Pixels that are looked at, about, to see which way the normals face."""


def render(
    scan: Path,
    /,
    *,
    output: Annotated[Path | None, Parameter(alias="-o")] = None,
    png: Path | None = None,
    exposure: float = 0.0,
    view: Annotated[View | None, Parameter(name="*", group="Camera")] = None,
    settings: Annotated[RenderSettings | None, Parameter(name="*", group="Settings")] = None,
    user_shader: Annotated[Path | None, Parameter(parse=True, group="Settings")] = None,
    light: Annotated[list[str] | None, Parameter(consume_multiple=False, group="Settings")] = None,
    on_invalid: OnInvalid = "error",
    device: str | None = None,
    tile_size: int = 16,
    check: bool = False,
    margin: bool = False,
    envelope: bool = False,
    allow_inexact: bool = False,
) -> None:
    """Render a scan to an OpenEXR file (every AOV), a PNG (the picture), or both.

    Parameters
    ----------
    scan : path
        PLY, text, mesh or other file that `splatcl info` knows.
    output : path
        .exr or .png file to write.
    png : path
        .png file to write.
    exposure : float
        Stops, for the PNG.
    user_shader : path
        File of OpenCL C with a function float4 shade(const Surface s, const Scene scene); sets --shader user.
    light : str
        A light, such as kind=spot,vector=0:2:1,direction=0:-1:0,color=1:1:1,shadow=pcf (docs/guide/lights.md), in place
        of the headlight; give the option again for each further light.
    on_invalid : str
        What to do with splats that have non-finite numbers or no area.
    device : str
        OpenCL device: an index of `splatcl devices`, or words of its name and version.
    tile_size : int
        Pixels; changes the speed, not the image.
    check : bool
        Render a second time and account for every splat, record, fragment and colour (docs/trust/probe.md).
    margin : bool
        Add to the .exr how near each pixel's decisions are to flipping (docs/trust/uncertainty.md).
    envelope : bool
        Add to the .exr the bounds within which every correct renderer lands (docs/trust/uncertainty.md).
    allow_inexact : bool
        Render even where the device or the environment may change bits of the image (`splatcl doctor`); recorded.
    """
    import splatcl

    outputs = check_outputs(output, png, exposure)
    if (margin or envelope) and all(path.suffix.lower() != ".exr" for path in outputs):
        raise SettingsError("--margin and --envelope are for .exr: give -o FILE.exr")
    settings = with_lights(with_user_shader(settings or RenderSettings(), user_shader), light)
    view = view or View()
    if settings.supersampling > 1 and (check or margin or envelope):
        raise SettingsError("--check, --margin and --envelope are of single samples: leave out --supersampling")
    camera = view.file_camera()
    renderer = splatcl.Renderer(device=device, tile_size=tile_size, allow_inexact=allow_inexact)

    splats, camera = read_scan(scan, on_invalid, view, camera)

    if settings.facing == "cull" and not splats.oriented:
        print("note: nothing is culled: estimated normals have no sign and are turned toward the viewer")
    start = time.perf_counter()
    with stage("Rendering"):
        frame = renderer.render(splats, camera, settings)
        covered = float((frame.color[..., 3] > 0).mean())
    say_rendered(frame, covered, _seconds_since(start), settings.epsilon == "auto")
    failed = _check(frame) if check else []
    with stage("Bounding the uncertainty"):
        if margin:
            frame.add_margin()
        if envelope:
            frame.add_envelope()
    save(frame, outputs, exposure)
    if failed:
        raise CheckError(f"{', '.join(failed)}: the check failed; the image is not to be trusted")


def say_rendered(frame: Frame, covered: float, took: str, auto_epsilon: bool) -> None:
    """Say what was rendered, how, and what may be wrong with it; `covered` is the share that splats cover."""
    print(f"rendered {frame.width}x{frame.height} in {took}; splats cover {covered:.1%} of the image")
    for hint in hints(frame, covered):
        print(f"note: {hint}")
    print(f"device {frame.metadata['device']}")
    if "inexact" in frame.metadata:
        print(f"note: inexact: {frame.metadata['inexact']}")
    print(f"epsilon {frame.metadata['epsilon']:.6g}{' (auto)' if auto_epsilon else ''}")


def hints(frame: Frame, covered: float) -> list[str]:
    """Say what may be wrong with the view of a picture of which `covered` is the share that splats cover."""
    if not covered:
        return ["nothing visible: check the camera's position, near and far and axes"]
    if frame.settings.facing == "keep" and most_face_away(frame):
        return ["most normals face away from the camera; try --facing flip"]
    return []


def most_face_away(frame: Frame) -> bool:
    """Whether the normals of over half of the covered pixels point away from the eye; of a sample of the pixels."""
    step = max(1, math.isqrt(frame.width * frame.height // MAX_SAMPLES))
    rows, columns = np.arange(0, frame.height, step), np.arange(0, frame.width, step)
    normal, covered = frame["N"][::step, ::step], frame.color[::step, ::step, 3] > 0
    camera = frame.camera
    along = normal[..., 2].astype(np.float64)
    if camera.projection == "perspective":
        along += normal[..., 0] * ((columns + 0.5 - camera.cx) / camera.fx)
        along += normal[..., 1] * ((rows + 0.5 - camera.cy) / camera.fy)[:, None]
    return bool(np.count_nonzero(along[covered] > 0) > np.count_nonzero(covered) / 2)


def _check(frame: Frame) -> list[str]:
    """Account for the frame, a line for each check; return the names of those that failed."""
    with stage("Checking"):
        checks = frame.check()
    for one in checks:
        print(f"check {one}")
    return [one.name for one in checks if not one.passed]


def check_outputs(output: Path | None, png: Path | None, exposure: float) -> list[Path]:
    """Return the files to write, after making sure that they can be written."""
    from splatcl.frame import output_format
    from splatcl.io.png import check_exposure
    from splatcl.util.atomic import check_writable

    outputs = [path for path in (output, png) if path is not None]
    if not outputs:
        raise SettingsError("nothing to write: give -o FILE.exr, --png FILE.png or both")
    if png is not None and output_format(png) != ".png":
        raise SettingsError(f"--png {png} does not end in .png")
    if output is not None and png is not None and output.resolve() == png.resolve():
        raise SettingsError(f"-o and --png both name {png}")
    check_exposure(exposure)
    if exposure and all(output_format(path) != ".png" for path in outputs):
        raise SettingsError("--exposure is for PNG; an .exr holds the linear values")
    for path in outputs:
        output_format(path)
        check_writable(path)
    return outputs


def save(frame: Frame, outputs: list[Path], exposure: float) -> None:
    """Write the frame to each output and say where it went."""
    from splatcl.frame import output_format

    for path in outputs:
        start = time.perf_counter()
        with stage(f"Writing {path.name}"):
            frame.save(path, exposure if output_format(path) == ".png" else 0.0)
        print(f"wrote {path} ({path.stat().st_size / 1e6:.2f} MB) in {_seconds_since(start)}")


def _seconds_since(start: float) -> str:
    return f"{time.perf_counter() - start:.2f} s"
