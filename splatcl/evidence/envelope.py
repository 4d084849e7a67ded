"""Envelopes on the frame's device, in double precision (kernels/evidence/envelope.cl).

The host computes the cases that margin.py names, and normal fields (host/envelope.py).
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splatcl.evidence.host import envelope as host
from splatcl.evidence.nearby import (
    VALUES,
    NearbySplats,
    double_context,
    draws_discs,
    has_strict_double,
    nearby,
    world_splats,
)
from splatcl.opencl.passes.attributes import fragment_arguments
from splatcl.opencl.session import Session, UploadedSplats
from splatcl.opencl.state.context import PassContext
from splatcl.scene.camera import Camera
from splatcl.scene.settings import RenderSettings

CHANNELS = {"Z": 1, "weight": 1, "albedo": 3, "N": 3}
"""Number of channels of each AOV with bounds."""


def envelope(
    session: Session,
    uploaded: UploadedSplats,
    camera: Camera,
    settings: RenderSettings,
    epsilon: float,
    tolerance: float,
) -> dict[str, NDArray[np.float32]]:
    """Return the bounds of Z, weight, albedo and N, as `host.envelope` does, on the session's device if possible.

    `uploaded` must be prepared for the settings (`UploadedSplats.prepared`). For `Session.call`.
    """
    host.validate(settings, tolerance)
    settings = replace(settings, circular=False)
    if not (draws_discs(uploaded, settings) and settings.normals == "constant" and has_strict_double(session)):
        return host.envelope(uploaded.splats, camera, settings, epsilon, tolerance)
    context = double_context(session, camera, settings)
    outputs = {f"{name}.{end}": context.image(n, "f4") for name, n in CHANNELS.items() for end in ("lo", "hi")}
    splats = world_splats(session, uploaded)
    view = context.view(splats.origin)
    for band in nearby(context, view, splats):
        _run_envelope(context, view, band, epsilon, tolerance, list(outputs.values()))
    shape = camera.height, camera.width
    shapes = {name: (*shape, n) if n > 1 else shape for name, n in CHANNELS.items()}
    named = {name: context.device.read(out, shapes[name[:-3]], np.float32) for name, out in outputs.items()}
    return host.without_blended_light(named, settings)


def _run_envelope(
    context: PassContext, view: Any, band: NearbySplats, epsilon: float, tolerance: float, outputs: list[Any]
) -> None:
    """Fill the band's part of the images, with a work-item per tile."""
    device, camera = context.device, context.camera
    sizes = {"at_block": 4, "weights": 2 * device.lanes_of(context.real) * 8, "extremes": 2 * 6 * 8}
    scratch = [device.scratch(f"nearby_{name}", band.num_records * size) for name, size in sizes.items()]
    (_, along_ray, falloff, _, *table), options = fragment_arguments(context, epsilon)
    context.run(
        "envelope", (band.last_tile - band.first_tile,), view, band.records, band.bounds, band.values, band.tile_begin,
        band.first_tile, band.first_entry, context.tiles_x, float(tolerance),
        4.0 * max(camera.width, camera.height), float(epsilon), along_ray, falloff, *table, *scratch, *outputs,
        REGION=context.tile_size, VALUES=VALUES, CENTER_LOW=0, PREFILTER=context.method["PREFILTER"], **options,
    )  # fmt: skip
