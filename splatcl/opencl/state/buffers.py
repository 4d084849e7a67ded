"""Records between the passes, on the device: the shape, space and unit of each buffer, once.

oracle/buffers.py has the twins. N splats, an image of H x W pixels, a band of T tiles with E entries. Eye space is x
right, y down, z forward, in scene units; raster space is in pixels (docs/specification.md). `real` is float32 or
float64, as the settings' precision says. A field of type `Any` is an OpenCL buffer; device/structs.py has its structs.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Channels = Mapping[str, tuple[Any, int]]
"""By the name of a splat attribute: the (H, W, 3) real image that holds its mean, and the channel, 0 to 2."""


@dataclass(frozen=True)
class TileLists:
    """Splats that may touch each tile of a band: one run per tile, in splat order.

    The band's entries are `ids[start:start + begin[-1]]`. Tile t's run begins at entry `begin[t - first_tile]`.
    """

    ids: Any  # (start + E,) or more, int32 splat indices
    keys: Any  # (start + E,) or more, int32 occlusion keys (kernels/passes/occlusion.h); unused if all is one layer
    start: int  # index in `ids` of the band's first entry
    begin: NDArray[np.int32]  # (T + 1,) each run's first entry, then E
    begin_buffer: Any  # (T + 1,) int32, `begin` on the device
    first_tile: int  # row-major index
    last_tile: int  # row-major index, exclusive


@dataclass(frozen=True)
class ProjectedSplats:
    """Projected splats of a band: one record per entry of its tile lists."""

    records: Any  # (E,) ProjectedSplat, tile order
    attributes: Any  # (E,) SplatAttributes
    boxes: Any  # (E, 4) int16 x_min y_min x_max y_max of footprint and pre-filter, whole pixels, ends included
    disc_near_z: Any  # (E,) real, eye z that no fragment of the disc is nearer than; NaN: no pixels, or other layer
    near_z: Any  # (E,) real, eye z that no fragment is nearer than; NaN: no pixels, or not projected
    extra: Any  # (E,) ProjectedExtra; empty if no build option needs it
    options: Mapping[str, Any]  # build options that say which fields of `extra` are set (kernels/splat/extra.h)


@dataclass(frozen=True)
class DepthBuffer:
    """Output of the visibility pass."""

    depth: Any  # (H, W) real eye z of the front-most splat, scene units; +inf where no footprint covers the pixel
    particleid: Any  # (H, W) uint32 index of that splat; 0xFFFFFFFF where there is none


@dataclass(frozen=True)
class GBuffer:
    """Output of the attribute pass: sums over the fragments accumulated at each pixel."""

    weight_sum: Any  # (H, W) real, of w
    color_sum: Any  # (H, W, 3) real, of w color, linear RGB
    normal_sum: Any  # (H, W, 3) real, of w n, eye space
    depth_sum: Any  # (H, W) real, of w z, scene units
    count: Any  # (H, W) uint32 number of fragments


@dataclass(frozen=True)
class Band:
    """A band of tiles after the visibility pass: the input of the attribute pass."""

    view: Any  # (1,) View, the camera
    lists: TileLists
    projected: ProjectedSplats
    depth: DepthBuffer
    epsilon: float  # depth tolerance, scene units


@dataclass(frozen=True)
class Raster:
    """A frame after the raster passes: the input of shading."""

    view: Any  # (1,) View, the camera
    depth: DepthBuffer
    gbuffer: GBuffer
    epsilon: float  # depth tolerance, scene units
    channels: Channels = field(default_factory=dict)


@dataclass(frozen=True)
class Surface:
    """Surface points to shade, one per pixel."""

    position: Any  # (H, W, 3) real, P, eye space, scene units
    normal: Any  # (H, W, 3) real, N, unit, eye space; 0 where it is undefined
    albedo: Any  # (H, W, 3) real, linear RGB
    weight: Any  # (H, W) real, w; > 0 where there is a surface
    channels: Channels = field(default_factory=dict)


@dataclass(frozen=True)
class Shadows:
    """Visibility passes from the lights."""

    maps: Any  # (L,) ShadowMap, one for each light with shadows
    depths: Any  # the maps' (size, size) real one after another, scene units along the light's z
    bias: tuple[float | None, ...]  # of each light, scene units along the light's z; None for one without shadows
