"""Maps from discs to screen ellipses, for the footprints "affine" ([ZPvBG01]) and "conic" ([ZRB04])."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from splatcl.oracle.buffers import NOTHING, Array
from splatcl.oracle.geometry.rays import CLEAR, TINY, UNIT, range_margin, to_raster
from splatcl.scene.camera import Camera
from splatcl.scene.settings import RenderSettings


@dataclass(frozen=True, eq=False)
class EllipseMaps:
    """Ellipses of N splats in disc coordinates w = M^-1 x, with x in pixels from the projected center.

    The contour is |w|^2 = (1 + g.w)^2. For the affine map g is 0 and the contour is the unit circle's image. For the
    conic map g = -(t_u,z, t_v,z) / c_z and the contour is the projected disc's ([ZRB04] section 4).
    """

    center: Array  # (N, 2) projected center, raster
    m: Array  # (N, 2, 2) M, pixels
    g: Array  # (N, 2)
    low_pass: float  # cutoff^2 times the variance of the low-pass filter, square pixels; 0 without EWA
    margin: Array  # (N,) signed: center's z in [near, far], and a contour that is an ellipse
    exists: Array  # (N,) bool

    @classmethod
    def of(cls, c: Array, t_u: Array, t_v: Array, camera: Camera, settings: RenderSettings) -> EllipseMaps:
        """Make the affine map, exact at the center (Heckbert), or under footprint="conic" the projected contour's.

        For the conic map let w = (u, v) den with den = 1 + g.w. The ray meets the disc where |w| <= den. `c`, `t_u` and
        `t_v` are (N, 3) in eye space.
        """
        t = np.stack([t_u, t_v], axis=-1)  # (N, 3, 2)
        focal = np.array([camera.fx, camera.fy])
        g, whole = np.zeros((len(c), 2)), np.full(len(c), np.inf)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            if camera.projection == "orthographic":
                center, m = c[:, :2], t[:, :2] * focal[:, None]
            else:
                center = c[:, :2] / c[:, 2:]
                m = (t[:, :2] - center[..., None] * t[:, 2:]) / c[:, 2, None, None] * focal[:, None]
                if settings.footprint == "conic":
                    g = -t[:, 2] / c[:, 2:]
                    reach = np.hypot(t_u[:, 2], t_v[:, 2])
                    whole = ((1 - CLEAR) * c[:, 2] - reach) / (UNIT * (4 * np.abs(c[:, 2]) + 4 * reach + TINY))
            in_range = range_margin(c[:, 2], np.abs(c[:, 2]) + TINY, camera)
            g = np.where((g**2).sum(axis=1, keepdims=True) < 1, g, 0.0)
        low_pass = (settings.cutoff * settings.prefilter_radius) ** 2 if settings.prefilter == "ewa" else 0.0
        exists = (in_range >= 0) & (whole > 0)
        return cls(to_raster(center, camera), m, g, low_pass, np.minimum(in_range, whole), exists)

    @cached_property
    def det_m(self) -> Array:
        """(N,) determinant of M, square pixels."""
        return self.m[:, 0, 0] * self.m[:, 1, 1] - self.m[:, 0, 1] * self.m[:, 1, 0]

    @cached_property
    def rest(self) -> Array:
        """(N,) 1 - |g|^2."""
        return 1 - (self.g**2).sum(axis=1)

    @cached_property
    def middle(self) -> Array:
        """(N, 2) center of the ellipse from the projected center, pixels.

        It is M w at the w where the gradient of (1 + g.w)^2 - |w|^2 vanishes.
        """
        return np.einsum("nij,nj->ni", self.m, self.g / self.rest[:, None])

    @cached_property
    def variance(self) -> Array:
        """(N, 2, 2) V, square pixels: x^T V^-1 x = 1 at the contour, with x from the ellipse's center."""
        inner = np.eye(2) + self.g[:, :, None] * self.g[:, None, :] / self.rest[:, None, None]
        return self.m @ inner @ self.m.swapaxes(1, 2) / self.rest[:, None, None]

    @cached_property
    def filtered(self) -> Array:
        """(N, 2, 2) V + cutoff^2 H, square pixels, where H is the low-pass filter's variance."""
        return self.variance + np.eye(2) * self.low_pass

    @cached_property
    def factor(self) -> Array:
        """(N,) sqrt(|V| / |V + cutoff^2 H|), the factor of the weight under EWA (compare [ZRB04] eq. 3)."""
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            det, filtered = self.det_m**2 / self.rest**3, self.filtered
            return np.sqrt(det / (filtered[:, 0, 0] * filtered[:, 1, 1] - filtered[:, 0, 1] ** 2))

    def bounds(self, exist: Array) -> Array:
        """Bound the filtered ellipses: (N, 4) x_min y_min x_max y_max, pixels; `NOTHING` unless they `exist`."""
        with np.errstate(invalid="ignore", over="ignore"):
            center, half = self.center + self.middle, np.sqrt(np.diagonal(self.filtered, axis1=1, axis2=2))
            bounds = np.hstack([center - half, center + half])
        bounds[~exist] = NOTHING
        return bounds
