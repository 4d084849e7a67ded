"""Footprints that are ellipses on the screen, and their Gaussians convolved with a low-pass one (EWA)."""

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
    """Per splat the ellipse that it covers."""

    maps: EllipseMaps
    usable: Array  # (N,) bool
    usable_margin: Array  # (N,) signed
    kappa: Array  # (N,)
    offset_error: float  # of a pixel's offset from the projected centre, 2^-24 pixels

    @classmethod
    def of(cls, projected: ProjectedSplats, discs: Discs, camera: Camera, settings: RenderSettings) -> Ellipses:
        """Return each splat's ellipse."""
        c, t_u, t_v = projected.center_eye, projected.tangent_u_eye, projected.tangent_v_eye
        maps = EllipseMaps.of(c, t_u, t_v, camera, settings)
        cosine, cosine_scale = facing_cosine(c, t_u, t_v, camera)
        edge = (np.abs(cosine) - EDGE_ON) / (UNIT * cosine_scale)
        margin = np.minimum(np.minimum(maps.margin, edge), projected.facing_margin)
        usable = maps.exists & (edge > 0) & ~projected.culled
        return cls(maps, usable, margin, discs.kappa, discs.offset_error)

    @property
    def factor(self) -> Array:
        """(N,) what EWA leaves of the peak; 0 where there is no ellipse."""
        return np.where(self.usable, self.maps.factor, 0.0)


@dataclass(frozen=True, eq=False)
class Coverage:
    """Pixels in a splat's footprint or pre-filter; (P, N), or (N,) for one each."""

    r_squared: Array  # +inf where a pixel is not in it
    r: Array  # whether or not it counts
    scale_r: Array
    margin: Array  # signed: of r <= 1 and all else that it needs


def cover(ellipses: Ellipses, filtered: bool, camera: Camera, s: Array) -> Coverage:
    """Say where pixels are in the ellipse, `filtered` by the low-pass filter or not; `s` as for `intersect`.

    The scale of r: rounding of x by 2 pixels' 2^-24, of the ellipse's short axis by 1 + kappa (less where the low-pass
    filter widens it), of the products that r is a sum of. What is farther away than the long axis is outside, whatever
    the short one is.
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
        away = np.hypot(x, y) / size  # r is at least that
        margin = np.where(away > 1, np.fmin(margin, (1 - away) / (UNIT * (4 * away + error / size))), margin)
        margin = np.nan_to_num(np.fmin(margin, ellipses.usable_margin), nan=-np.inf)
    r_squared = np.where(ellipses.usable, np.nan_to_num(r_squared, nan=np.inf), np.inf)
    return Coverage(r_squared, r, scale_r, margin)
