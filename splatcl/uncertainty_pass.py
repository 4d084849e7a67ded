"""Margins and envelopes on the frame's device, in double precision: margin.cl and envelope.cl of kernels/evidence.

The kernels follow the profile of docs/reproducibility.md, so every device gives the same bits. A device without
double precision leaves the work to the host (splatcl/uncertainty.py, splatcl/envelope.py), whose results differ by
float64's rounding alone. So it does where splats are drawn by anything but ray-cast discs without clip lines.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splatcl import envelope as host
from splatcl import oracle, uncertainty
from splatcl.camera import Camera
from splatcl.errors import DeviceError
from splatcl.nearby import VALUES, NearbySplats, nearby, upload
from splatcl.passes import PIXEL_GROUP, Passes
from splatcl.pipeline import fragment_arguments
from splatcl.render import Renderer, Resident
from splatcl.settings import RenderSettings

TILE = 8
"""Pixels: a work-item's share. (Bits do not depend on it.)"""
CHANNELS = {"Z": 1, "weight": 1, "albedo": 3, "N": 3}
"""Of each AOV that has bounds."""


def margin(
    renderer: Renderer, resident: Resident, camera: Camera, settings: RenderSettings, epsilon: float
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return what `uncertainty.margin` does, from the renderer's device where it can. For `Renderer.call`.

    The resident's splats are prepared for the settings already (`Resident.prepared`), as a frame's are.
    """
    settings = replace(settings, circular=False)
    if not (draws_discs(resident, settings) and has_strict_double(renderer)):
        return uncertainty.margin(resident.splats, camera, settings, epsilon)
    passes = Passes(renderer.device, camera, settings, TILE, "double")
    shape = camera.height, camera.width
    outputs = [passes.image(dtype="f4") for _ in range(2)]
    splats = _world(renderer, resident)
    view = passes.view(splats.origin)
    for band in nearby(passes, view, splats):
        _run_margin(passes, view, band, epsilon, outputs)
    units, raw = (passes.device.read(buffer, shape, np.float32) for buffer in outputs)
    return units, raw


def envelope(
    renderer: Renderer,
    resident: Resident,
    camera: Camera,
    settings: RenderSettings,
    epsilon: float,
    tolerance: float,
) -> dict[str, NDArray[np.float32]]:
    """Return what `envelope.envelope` does, from the renderer's device where it can. As `margin`."""
    host.check(settings, tolerance)
    settings = replace(settings, circular=False)
    if not (draws_discs(resident, settings) and settings.normals == "constant" and has_strict_double(renderer)):
        return host.envelope(resident.splats, camera, settings, epsilon, tolerance)
    passes = Passes(renderer.device, camera, settings, TILE, "double")
    outputs = {f"{name}.{end}": passes.image(n, "f4") for name, n in CHANNELS.items() for end in ("lo", "hi")}
    splats = _world(renderer, resident)
    view = passes.view(splats.origin)
    for band in nearby(passes, view, splats):
        _run_envelope(passes, view, band, epsilon, tolerance, list(outputs.values()))
    shape = camera.height, camera.width
    shapes = {name: (*shape, n) if n > 1 else shape for name, n in CHANNELS.items()}
    named = {name: passes.device.read(out, shapes[name[:-3]], np.float32) for name, out in outputs.items()}
    return host.bounded(named, settings)


def draws_discs(resident: Resident, settings: RenderSettings) -> bool:
    """Whether the splats are discs that rays meet, whole: what the kernels know."""
    return settings.footprint == "raycast" and resident.splats.clip is None


def has_strict_double(renderer: Renderer) -> bool:
    """Whether the renderer's device computes in double precision as the kernels' profile asks."""
    if not renderer.supports_double:
        return False
    strictness = renderer.device.strictness
    try:
        strictness.options("double")
    except DeviceError:
        return False
    return not strictness.reason("double")


def _world(renderer: Renderer, resident: Resident) -> Any:
    """Return the resident's splats in double precision, uploaded once."""
    key = (renderer.device, "nearby")
    if key not in resident._on_device:
        resident._on_device[key] = upload(renderer.device, resident.splats)
    return resident._on_device[key]


def _run_margin(passes: Passes, view: Any, band: NearbySplats, epsilon: float, outputs: list[Any]) -> None:
    """Fill the band's part of the images, a work-item for each tile, or for each pixel on a GPU."""
    size, group, region = band.last_tile - band.first_tile, 1, TILE
    if passes.device.mapping == "pixel":
        size, group, region = size * TILE**2, PIXEL_GROUP, 1
    passes.run(
        "margin", (size,), view, band.records, band.tile_begin, band.first_tile, band.first_entry, passes.tiles_x,
        oracle.OFFSET_ERROR, float(epsilon), passes.settings.along == "ray", *outputs, group=group, REGION=region,
        CENTER_LOW=0,
    )  # fmt: skip


def _run_envelope(
    passes: Passes, view: Any, band: NearbySplats, epsilon: float, tolerance: float, outputs: list[Any]
) -> None:
    """Fill the band's part of the images, a work-item for each tile."""
    device, camera = passes.device, passes.camera
    sizes = {"at_block": 4, "weights": 2 * device.lanes_of(passes.real) * 8, "extremes": 2 * 6 * 8}
    scratch = [device.scratch(f"nearby_{name}", band.num_records * size) for name, size in sizes.items()]
    (_, along_ray, falloff, _, *table), options = fragment_arguments(passes, epsilon)
    passes.run(
        "envelope", (band.last_tile - band.first_tile,), view, band.records, band.bounds, band.values, band.tile_begin,
        band.first_tile, band.first_entry, passes.tiles_x, float(tolerance),
        4.0 * max(camera.width, camera.height), float(epsilon), along_ray, falloff, *table, *scratch, *outputs,
        REGION=TILE, VALUES=VALUES, CENTER_LOW=0, PREFILTER=passes.method["PREFILTER"], **options,
    )  # fmt: skip
