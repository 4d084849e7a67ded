"""``splatcl render``: a scan in, an OpenEXR file or a PNG out."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated

import numpy as np
from cyclopts import Parameter

from splatcl.cli.options.device import AllowInexactOption, DeviceOption, TileSizeOption
from splatcl.cli.options.groups import EVIDENCE
from splatcl.cli.options.inputs import OnInvalidOption, ScanArgument, read_scan
from splatcl.cli.options.light import LightOption, light_changes
from splatcl.cli.options.outputs import (
    ExposureOption,
    OutputOption,
    PngOption,
    check_outputs,
    save_images,
    seconds_since,
)
from splatcl.cli.options.settings import SettingsOptions
from splatcl.cli.options.user_shader import UserShaderOption, with_user_shader
from splatcl.cli.options.view import View, ViewOptions
from splatcl.errors import CheckError, SettingsError
from splatcl.scene.settings import RenderSettings
from splatcl.util.progress import stage

if TYPE_CHECKING:
    from splatcl.frame import Frame

MAX_SAMPLES = 1_000_000
"""Approximate number of pixels whose normals `most_face_away` samples."""


def render(
    scan: ScanArgument,
    /,
    *,
    output: OutputOption = None,
    png: PngOption = None,
    exposure: ExposureOption = 0.0,
    on_invalid: OnInvalidOption = "error",
    view: ViewOptions = None,
    settings: SettingsOptions = None,
    user_shader: UserShaderOption = None,
    light: LightOption = None,
    check: Annotated[bool, Parameter(group=EVIDENCE)] = False,
    margin: Annotated[bool, Parameter(group=EVIDENCE)] = False,
    envelope: Annotated[bool, Parameter(group=EVIDENCE)] = False,
    device: DeviceOption = None,
    tile_size: TileSizeOption = 16,
    allow_inexact: AllowInexactOption = False,
) -> None:
    """Render a scan to an OpenEXR file (every AOV), a PNG (the picture), or both.

    Parameters
    ----------
    check : bool
        Render again and account for every splat, record, fragment and color (docs/trust/probe.md).
    margin : bool
        Add an AOV to the .exr: how near each pixel's decisions are to flipping (docs/trust/uncertainty.md).
    envelope : bool
        Add AOVs to the .exr: bounds that hold for every correct renderer (docs/trust/uncertainty.md).
    """
    import splatcl

    outputs = check_outputs(output, png, exposure)
    if (margin or envelope) and all(path.suffix.lower() != ".exr" for path in outputs):
        raise SettingsError("--margin and --envelope need an .exr; give -o FILE.exr")
    settings = with_user_shader(settings or RenderSettings(), user_shader)
    settings = replace(settings, **light_changes(light))
    if settings.supersampling > 1 and (check or margin or envelope):
        raise SettingsError("--check, --margin and --envelope need one sample per pixel; leave out --supersampling")
    view = view or View()
    camera = view.file_camera()
    renderer = splatcl.Renderer(device=device, tile_size=tile_size, allow_inexact=allow_inexact)

    splats, camera = read_scan(scan, on_invalid, view, camera)

    if settings.facing == "cull" and not splats.oriented:
        print("note: --facing cull has no effect: estimated normals have no sign and turn toward the eye")
    start = time.perf_counter()
    with stage("Rendering"):
        frame = renderer.render(splats, camera, settings)
        covered = float((frame.color[..., 3] > 0).mean())
    print_rendered(frame, covered, seconds_since(start), settings.epsilon == "auto")
    failed = _check(frame) if check else []
    with stage("Bounding the uncertainty"):
        if margin:
            frame.add_margin()
        if envelope:
            frame.add_envelope()
    save_images(frame, outputs, exposure)
    if failed:
        raise CheckError(f"{', '.join(failed)}: the check failed; do not trust this image")


def print_rendered(frame: Frame, covered: float, took: str, auto_epsilon: bool) -> None:
    """Print size, time, device and epsilon of a render, with notes on likely mistakes.

    Parameters
    ----------
    covered : float
        Share of the image that splats cover.
    took : str
        Time of the render, such as "0.52 s".
    auto_epsilon : bool
        Whether the render chose epsilon.
    """
    print(f"rendered {frame.width}x{frame.height} in {took}; splats cover {covered:.1%} of the image")
    for hint in hints(frame, covered):
        print(f"note: {hint}")
    print(f"device {frame.metadata['device']}")
    if "inexact" in frame.metadata:
        print(f"note: inexact: {frame.metadata['inexact']}")
    print(f"epsilon {frame.metadata['epsilon']:.6g}{' (auto)' if auto_epsilon else ''}")


def hints(frame: Frame, covered: float) -> list[str]:
    """Return likely mistakes in the view; `covered` is the share of the image that splats cover."""
    if not covered:
        return ["no splat is visible; check the camera's position, axes, near and far"]
    if frame.settings.facing == "keep" and most_face_away(frame):
        return ["most normals face away from the camera; try --facing flip"]
    return []


def most_face_away(frame: Frame) -> bool:
    """Return True if over half of the covered pixels have a normal away from the eye, by a sample of them."""
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
    """Run the checks of the frame, print a line for each, and return the names of the failed ones."""
    with stage("Checking"):
        checks = frame.check()
    for one in checks:
        print(f"check {one}")
    return [one.name for one in checks if not one.passed]
