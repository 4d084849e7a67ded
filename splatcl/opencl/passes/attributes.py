"""The attribute pass on the device: weighted sums over the fragments within epsilon of depth(p)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from splatcl.opencl.state.buffers import Band, Channels, GBuffer
from splatcl.opencl.state.context import PER_FRAGMENT, PassContext, shader_header
from splatcl.opencl.state.lights import shading_structs
from splatcl.opencl.state.upload import AttributeGroup

Images = tuple[Any, Any]
"""Two (H, W, 3) real images: the blended attributes of one `AttributeGroup`."""


def attributes(context: PassContext, band: Band, gbuffer: GBuffer) -> None:
    """Fill the band's part of `gbuffer`: sums over the fragments within epsilon of depth(p), in splat order."""
    projected = band.projected
    structs = shading_structs(context) if projected.options["SHADING"] == PER_FRAGMENT else ()
    _run_attributes(
        context, band, projected.records, gbuffer.weight_sum, gbuffer.color_sum, gbuffer.normal_sum, gbuffer.depth_sum,
        gbuffer.count, *structs, CHANNELS=0, **projected.options,
    )  # fmt: skip


def attribute_images(context: PassContext, groups: Sequence[AttributeGroup]) -> list[Images]:
    """Return the images that `attribute_channels` fills, with undefined content."""
    return [(context.image(3), context.image(3)) for _ in groups]


def named_channels(groups: Sequence[AttributeGroup], images: Sequence[Images]) -> Channels:
    """Return the image and channel of each splat attribute, by name."""
    return {
        name: (pair[k // 3], k % 3)
        for group, pair in zip(groups, images, strict=True)
        for k, name in enumerate(group.names)
        if name
    }


def attribute_channels(
    context: PassContext, band: Band, groups: Sequence[AttributeGroup], images: Sequence[Images]
) -> None:
    """Fill the band's part of `images` with the splats' own attributes, weighted as `attributes` weighs colors."""
    for group, pair in zip(groups, images, strict=True):
        _run_channels(context, band, group.values, pair)


def _run_channels(context: PassContext, band: Band, values: Any, images: Images) -> None:
    nothing = context.device.buffer(0)
    options = {
        **band.projected.options,
        "FIELD": 0,
        "SHADING": 0,
        "CHANNELS": 1,
        "SHADER": shader_header("albedo"),
    }
    _run_attributes(context, band, values, nothing, *images, nothing, nothing, **options)


def _run_attributes(context: PassContext, band: Band, values: Any, *images: Any, **options: str | int) -> None:
    lists, projected = band.lists, band.projected
    arguments, weighting = fragment_arguments(context, band.epsilon)
    context.run_raster(
        "attributes", lists, band.view, projected.records, projected.extra, projected.attributes, projected.boxes,
        projected.near_z, values, lists.ids, lists.start, lists.begin_buffer, lists.first_tile, context.tiles_x,
        *arguments, band.depth.depth, *images, **weighting | options,
    )  # fmt: skip


def fragment_arguments(context: PassContext, epsilon: float) -> tuple[tuple[Any, ...], dict[str, int]]:
    """Return the kernel arguments and build options that, with `PassContext.method`, select and weigh fragments."""
    settings = context.settings
    kernel = {"gaussian": 0, "constant": 1, "table": 2}[settings.kernel]
    kernel += settings.kernel == "table" and settings.kernel_lookup == "linear"
    table = np.array(settings.kernel_table or (0,), context.real)
    arguments = (
        float(epsilon), settings.along == "ray", -(settings.cutoff**2) / 2, settings.prefilter_radius**-2,
        context.constant(table), len(table),
    )  # fmt: skip
    options = {
        "KERNEL": int(kernel),
        "TABLE_TEXTURE": int(settings.table_addressing == "texture"),
        "TABLE_OVER_R2": int(settings.table_over == "r2"),
        "TARGET": context.target,
        "STRICT_EPSILON": int(settings.epsilon_test == "strict"),
    }
    return arguments, options
