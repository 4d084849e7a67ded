"""Records between the passes: the shape, space and unit of each array, once (opencl/state/buffers.py has the twins).

N splats, an image of H x W pixels. Eye space is x right, y down, z forward, in scene units; raster space is in pixels
(docs/specification.md). Arrays are float64 unless their comment gives another type. Margins are in units of 2^-24
times a scale (splatcl/oracle/__init__.py).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splatcl.scene.camera import Camera

Array = NDArray[Any]
NO_SPLAT = np.uint32(0xFFFFFFFF)
"""`particleid` of a pixel that no footprint covers."""
NOTHING = (np.inf, np.inf, -np.inf, -np.inf)
"""Bounds (x_min, y_min, x_max, y_max) that contain no point."""


@dataclass(frozen=True, eq=False)
class ProjectedSplats:
    """Splats in eye space (scene units), with their bounds in raster space (pixels)."""

    center_eye: Array  # (N, 3)
    tangent_u_eye: Array  # (N, 3)
    tangent_v_eye: Array  # (N, 3)
    normal_eye: Array  # (N, 3) unit; turned toward the eye under facing="flip"
    center_raster: Array  # (N, 2) projected center; NaN where z <= 0 under perspective
    bounds: Array  # (N, 4) x_min y_min x_max y_max of footprint and pre-filter; `NOTHING` for a splat without either
    culled: Array  # (N,) bool: dropped by facing="cull"
    facing_margin: Array  # (N,) signed: < 0 where culled; +inf under facing="keep"
    prefilter_point: Array  # (N, 2) point from which r2 is measured, if there is a pre-filter
    prefilter_error: Array  # (N,) float32 error of that point, 2^-24 pixels
    prefilter_margin: Array  # (N,) signed: center's z in [near, far]; -inf where there is no pre-filter
    field_u: Array  # (N, 3) change of the normal along u, eye space; zero for a constant normal
    field_v: Array  # (N, 3) change of the normal along v
    clip: Array  # (N, 2, 3) clip lines a u + b v + c >= 0; zeros for no line

    @property
    def prefilter_center(self) -> Array:
        """(N, 2) point from which r2 is measured, pixels; NaN where there is no pre-filter."""
        return np.where(self.prefilter_margin[:, None] >= 0, self.prefilter_point, np.nan)


@dataclass(frozen=True, eq=False)
class DepthBuffer:
    """Output of the visibility pass."""

    depth: Array  # (H, W) eye z of the front-most splat, scene units; +inf where no footprint covers the pixel
    particleid: Array  # (H, W) uint32 index of that splat; `NO_SPLAT` where there is none
    margin: Array  # (H, W) least margin of all visibility decisions
    depth_margin: Array  # (H, W) the same without the choice of the front-most splat (coplanar splats always tie)


@dataclass(frozen=True, eq=False)
class GBuffer:
    """Output of the attribute pass: sums over the fragments accumulated at each pixel."""

    weight_sum: Array  # (H, W) of w
    color_sum: Array  # (H, W, 3) of w color, linear RGB
    normal_sum: Array  # (H, W, 3) of w n, eye space
    depth_sum: Array  # (H, W) of w z, scene units
    count: Array  # (H, W) uint32 number of fragments
    margin: Array  # (H, W) least margin of all decisions of the attribute pass
    attribute_sum: Mapping[str, Array] = field(default_factory=dict)  # (H, W) of w a, by the attribute's name


@dataclass(frozen=True, eq=False)
class Surface:
    """Surface points to shade: pixels (H, W), fragments (P, N) or splats (N,), here written (...)."""

    position: Array  # (..., 3) P, eye space, scene units
    normal: Array  # (..., 3) N, unit, eye space; 0 where it is undefined
    albedo: Array  # (..., 3) linear RGB
    weight: Array  # (...) w; > 0 where there is a surface
    specular: Array | float  # (..., 1) Phong's specular coefficient, or one number for all points
    shininess: Array | float  # (..., 1) Phong's exponent, or one number for all points

    @property
    def covered(self) -> Array:
        """(...) bool, whether there is a surface."""
        return self.weight > 0


@dataclass(frozen=True, eq=False)
class ShadowMap:
    """Visibility pass from one light."""

    camera: Camera  # the light's view
    depth: DepthBuffer  # scene units along the light's z
    bias: float  # scene units along the light's z
    filtered: bool  # percentage closer filtering, not the nearest texel


Shadows = Sequence[ShadowMap | None]
"""A shadow map for each light; None for a light without shadows."""
