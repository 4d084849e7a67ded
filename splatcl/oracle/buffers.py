"""The records that the passes hand on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splatcl.scene.camera import Camera

Array = NDArray[Any]
NO_SPLAT = np.uint32(0xFFFFFFFF)
NOTHING = (np.inf, np.inf, -np.inf, -np.inf)
"""Bounds that cover nothing."""


@dataclass(frozen=True, eq=False)
class ProjectedSplats:
    """Splats in eye space (scene units) with their projections in raster space (pixels)."""

    center_eye: Array  # (N, 3)
    tangent_u_eye: Array  # (N, 3)
    tangent_v_eye: Array  # (N, 3)
    normal_eye: Array  # (N, 3) unit; turned toward the eye under facing="flip"
    center_raster: Array  # (N, 2) the projected centre; NaN where a perspective z <= 0
    bounds: Array  # (N, 4) x_min y_min x_max y_max of what the splat can cover; `NOTHING` where nothing
    culled: Array  # (N,) bool: dropped by facing="cull"
    facing_margin: Array  # (N,) signed: < 0 culled; +inf where facing decides nothing
    prefilter_point: Array  # (N, 2) where r2 would be measured from
    prefilter_error: Array  # (N,) float32 error of that point, 2^-24 pixels
    prefilter_margin: Array  # (N,) signed: the centre's z in [near, far]; -inf where there is no pre-filter
    field_u: Array  # (N, 3) the normal changes so much along u; zero where it does not
    field_v: Array  # (N, 3)
    clip: Array  # (N, 2, 3) clip lines a u + b v + c >= 0; zeros for none

    @property
    def prefilter_center(self) -> Array:
        """(N, 2) where r2 is measured from; NaN where there is no pre-filter."""
        return np.where(self.prefilter_margin[:, None] >= 0, self.prefilter_point, np.nan)


@dataclass(frozen=True, eq=False)
class DepthBuffer:
    """What the visibility pass knows of each pixel."""

    depth: Array  # (H, W) eye-space z of the front-most disc, scene units; +inf where none
    particleid: Array  # (H, W) uint32 index of that splat; 0xFFFFFFFF where none
    margin: Array  # (H, W) of every visibility decision, which splat is front-most included
    depth_margin: Array  # (H, W) the same without which splat is front-most (coplanar splats tie everywhere)


@dataclass(frozen=True, eq=False)
class GBuffer:
    """Sums over the fragments accumulated at each pixel."""

    weight_sum: Array  # (H, W)
    color_sum: Array  # (H, W, 3) linear RGB
    normal_sum: Array  # (H, W, 3) eye space
    depth_sum: Array  # (H, W) of w z, scene units
    count: Array  # (H, W) uint32 fragments
    margin: Array  # (H, W) of every decision of the attribute pass
    channel_sum: Array | None = None  # (H, W, K)


@dataclass(frozen=True, eq=False)
class ShadowMap:
    """What one light sees: depth, scene units along its own z."""

    camera: Camera
    depth: DepthBuffer
    bias: float
    filtered: bool


Shadows = Sequence[ShadowMap | None]
