"""The attribute pass on the device: weighted sums over the fragments within epsilon of depth(p)."""

from __future__ import annotations

from typing import Any

import numpy as np

from splatcl.opencl.state.buffers import Band, GBuffer
from splatcl.opencl.state.context import PER_FRAGMENT, PassContext
from splatcl.opencl.state.lights import shading_structs


def attributes(context: PassContext, band: Band, gbuffer: GBuffer) -> None:
    """Fill the band's part of `gbuffer`: sums over the fragments within epsilon of depth(p)."""
    projected = band.projected
    structs = shading_structs(context) if projected.options["SHADING"] == PER_FRAGMENT else ()
    _run_attributes(
        context, band, projected.records, gbuffer.weight_sum, gbuffer.color_sum, gbuffer.normal_sum, gbuffer.depth_sum,
        gbuffer.count, *structs, CHANNELS=0, **projected.options,
    )  # fmt: skip


def channels(context: PassContext, band: Band, values: Any, images: tuple[Any, Any]) -> None:
    """Fill the band's part of two (H, W, 3) images: means of six further channels, weighted as `attributes` does."""
    nothing = context.device.buffer(0)
    options = {
        **band.projected.options,
        "FIELD": 0,
        "SHADING": 0,
        "CHANNELS": 1,
        "SHADER": '"shading/shaders/albedo.h"',
    }
    _run_attributes(context, band, values, nothing, *images, nothing, nothing, **options)


def _run_attributes(context: PassContext, band: Band, values: Any, *images: Any, **options: str | int) -> None:
    lists, projected = band.lists, band.projected
    arguments, how = fragment_arguments(context, band.epsilon)
    context.run_raster(
        "attributes", lists, band.view, projected.records, projected.extra, projected.attributes, projected.boxes,
        projected.near_z, values, lists.ids, lists.start, lists.begin_buffer, lists.first_tile, context.tiles_x,
        *arguments, band.depth.depth, *images, **how | options,
    )  # fmt: skip


def fragment_arguments(context: PassContext, epsilon: float) -> tuple[tuple[Any, ...], dict[str, int]]:
    """Return the arguments and build options that, with `PassContext.method`, select and weigh fragments."""
    settings = context.settings
    kernel = {"gaussian": 0, "constant": 1, "table": 2}[settings.kernel]
    kernel += settings.kernel == "table" and settings.kernel_lookup == "linear"
    table = np.array(settings.kernel_table or (0,), context.real)
    arguments = (
        float(epsilon), settings.along == "ray", -(settings.cutoff**2) / 2, settings.prefilter_radius**-2,
        context.constant(table), len(table),
    )  # fmt: skip
    return arguments, {"KERNEL": int(kernel), "TARGET": context.target}
