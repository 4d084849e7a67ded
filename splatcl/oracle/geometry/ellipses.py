"""Elliptical footprints, with or without EWA's low-pass filter ([ZPvBG01], [ZRB04])."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from splatcl.oracle.buffers import Array, ProjectedSplats
from splatcl.oracle.geometry.discs import Discs
from splatcl.oracle.geometry.ellipse_maps import EllipseMaps
from splatcl.oracle.geometry.rays import EDGE_ON, UNIT, facing_cosine, to_raster
from splatcl.scene.camera import Camera
from splatcl.scene.settings import RenderSettings


@dataclass(frozen=True, eq=False)
class Ellipses:
    """Ellipses that N splats cover."""

    maps: EllipseMaps
    usable: Array  # (N,) bool: the ellipse exists, and the splat is neither edge-on nor culled
    usable_margin: Array  # (N,) signed
    kappa: Array  # (N,) as in `Discs`
    offset_error: float  # of a pixel's offset from the projected center, 2^-24 pixels

    @classmethod
    def of(cls, projected: ProjectedSplats, discs: Discs, camera: Camera, settings: RenderSettings) -> Ellipses:
        """Prepare the ellipses under footprint="affine" or "conic"."""
        c, t_u, t_v = projected.center_eye, projected.tangent_u_eye, projected.tangent_v_eye
        maps = EllipseMaps.of(c, t_u, t_v, camera, settings)
        cosine, cosine_scale = facing_cosine(c, t_u, t_v, camera)
        edge = (np.abs(cosine) - EDGE_ON) / (UNIT * cosine_scale)
        margin = np.minimum(np.minimum(maps.margin, edge), projected.facing_margin)
        usable = maps.exists & (edge > 0) & ~projected.culled
        return cls(maps, usable, margin, discs.kappa, discs.offset_error)

    @property
    def factor(self) -> Array:
        """(N,) factor of the weight under EWA; 0 where there is no ellipse."""
        return np.where(self.usable, self.maps.factor, 0.0)


@dataclass(frozen=True, eq=False)
class Coverage:
    """Pixels against footprints or pre-filters: arrays are (P, N) for P pixels and N splats, or (N,) for one each."""

    r_squared: Array  # r^2; the pixel is inside where it is <= 1; +inf without a footprint or pre-filter
    r: Array  # r, even where r_squared is +inf
    scale_r: Array  # rounding error of r, 2^-24
    margin: Array  # signed, of r <= 1 and its other conditions


def cover(ellipses: Ellipses, filtered: bool, camera: Camera, s: Array) -> Coverage:
    """Evaluate r of pixels in their ellipses, widened by the low-pass filter if `filtered`; `s` as for `intersect`.

    r^2 = x^T V^-1 x, or x^T (V + cutoff^2 H)^-1 x if `filtered`, with x from the ellipse's center. The scale of r adds
    three roundings: x by `offset_error`, the short axis by 1 + kappa, and the products in the sum r^2. The
    low-pass filter reduces the second one. A pixel farther away than the long axis is outside for any short axis.
    """
    maps, error = ellipses.maps, ellipses.offset_error
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        x, y = np.moveaxis(to_raster(s, camera) - maps.center - maps.middle, -1, 0)
        if filtered and maps.low_pass:
            v = maps.filtered
            xx, xy, yy = v[:, 0, 0], v[:, 0, 1], v[:, 1, 1]
            det = xx * yy - xy * xy
            r_squared = (yy * x**2 - 2 * xy * x * y + xx * y**2) / det
            along = (np.sqrt(yy) * np.abs(x) + np.sqrt(xx) * np.abs(y)) / np.sqrt(det)
            thin = np.sqrt((xx + yy) / det)
            steep, size = 1 + ellipses.kappa * maps.factor**2, np.sqrt(xx + yy)
        else:
            (a, b), (c, d) = maps.m[:, 0].T, maps.m[:, 1].T
            det, g = maps.det_m, maps.g
            p, q = (d * x - b * y) / det, (a * y - c * x) / det
            r_squared = (p**2 + q**2 - (g[:, 0] * p + g[:, 1] * q) ** 2) * maps.rest
            along = ((np.abs(c) + np.abs(d)) * np.abs(x) + (np.abs(a) + np.abs(b)) * np.abs(y)) / np.abs(det)
            thin = (np.abs(a) + np.abs(b) + np.abs(c) + np.abs(d)) / np.abs(det)
            steep, size = 1 + ellipses.kappa, np.sqrt(maps.variance.trace(axis1=1, axis2=2))
        r = np.sqrt(np.maximum(r_squared, 0.0))
        scale_r = steep * r + 4 * along + error * thin
        margin = (1 - r) / (UNIT * scale_r)
        away = np.hypot(x, y) / size  # a lower bound of r
        margin = np.where(away > 1, np.fmin(margin, (1 - away) / (UNIT * (4 * away + error / size))), margin)
        margin = np.nan_to_num(np.fmin(margin, ellipses.usable_margin), nan=-np.inf)
    r_squared = np.where(ellipses.usable, np.nan_to_num(r_squared, nan=np.inf), np.inf)
    return Coverage(r_squared, r, scale_r, margin)
