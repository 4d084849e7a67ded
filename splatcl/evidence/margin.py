"""Margins on the frame's device, in double precision (kernels/evidence/margin.cl).

The kernel keeps the strict profile, so every device gives the same bits. The host computes the other cases
(host/margin.py): devices without strict double precision, splats other than ray-cast discs without clip lines, and a
`filter_depth` other than the center's. Its margins differ from the kernel's only by float64's rounding.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splatcl.evidence.host import margin as host
from splatcl.evidence.nearby import NearbySplats, double_context, draws_discs, has_strict_double, nearby, world_splats
from splatcl.opencl.session import Session, UploadedSplats
from splatcl.opencl.state.context import PIXEL_GROUP, PassContext
from splatcl.oracle.geometry.rays import OFFSET_ERROR
from splatcl.scene.camera import Camera
from splatcl.scene.settings import RenderSettings


def margin(
    session: Session, uploaded: UploadedSplats, camera: Camera, settings: RenderSettings, epsilon: float
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return each pixel's margin and its raw distance, as `host.margin` does, on the session's device if possible.

    `uploaded` must be prepared for the settings (`UploadedSplats.prepared`). For `Session.call`.
    """
    settings = replace(settings, circular=False)
    if not (draws_discs(uploaded, settings) and has_strict_double(session)):
        return host.margin(uploaded.splats, camera, settings, epsilon)
    context = double_context(session, camera, settings)
    shape = camera.height, camera.width
    outputs = [context.image(dtype="f4") for _ in range(2)]
    splats = world_splats(session, uploaded)
    view = context.view(splats.origin)
    for band in nearby(context, view, splats):
        _run_margin(context, view, band, epsilon, outputs)
    units, raw = (context.device.read(buffer, shape, np.float32) for buffer in outputs)
    return units, raw


def _run_margin(context: PassContext, view: Any, band: NearbySplats, epsilon: float, outputs: list[Any]) -> None:
    """Fill the band's part of the images, with a work-item per tile, or per pixel on a GPU."""
    size, group, region = band.last_tile - band.first_tile, 1, context.tile_size
    if context.device.mapping == "pixel":
        size, group, region = size * context.tile_size**2, PIXEL_GROUP, 1
    context.run(
        "margin", (size,), view, band.records, band.tile_begin, band.first_tile, band.first_entry, context.tiles_x,
        OFFSET_ERROR, float(epsilon), context.settings.along == "ray", *outputs, group=group, REGION=region,
        CENTER_LOW=0, STRICT_EPSILON=int(context.settings.epsilon_test == "strict"),
    )  # fmt: skip
