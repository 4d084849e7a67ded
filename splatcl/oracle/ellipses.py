"""Footprints that are ellipses on the screen, and their Gaussians convolved with a low-pass one (EWA)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from splatcl.camera import Camera
from splatcl.oracle.discs import _Discs, _Hits
from splatcl.oracle.project import ProjectedSplats
from splatcl.oracle.rays import CLEAR, EDGE_ON, OFFSET_ERROR, TINY, UNIT, Array, _cosine, _range_margin, _raster
from splatcl.settings import RenderSettings


@dataclass(frozen=True, eq=False)
class _Ellipses:
    """Per splat an ellipse of disc coordinates w = M^-1 x, x in pixels from the projected centre.

    Its contour is |w|^2 = (1 + g.w)^2: the unit circle where g = 0 (the affine map), the projected disc's where g is
    minus the tangents' share of depth.
    """

    center: Array  # (N, 2) projected centre, raster
    m: Array  # (N, 2, 2) M
    g: Array  # (N, 2)
    low_pass: float  # cutoff^2 times the low-pass filter's variance, square pixels
    usable: Array  # (N,) bool
    usable_margin: Array  # (N,) signed
    kappa: Array  # (N,)

    @property
    def det_m(self) -> Array:
        """(N,) |M|."""
        return self.m[:, 0, 0] * self.m[:, 1, 1] - self.m[:, 0, 1] * self.m[:, 1, 0]

    @property
    def rest(self) -> Array:
        """(N,) 1 - |g|^2."""
        return 1 - (self.g**2).sum(axis=1)

    @property
    def middle(self) -> Array:
        """(N, 2) the ellipse's own centre, w: where the gradient of (1 + g.w)^2 - |w|^2 vanishes."""
        return self.g / self.rest[:, None]

    @property
    def variance(self) -> Array:
        """(N, 2, 2) V: x^T V^-1 x = 1 at the contour, about the ellipse's centre."""
        inner = np.eye(2) + self.g[:, :, None] * self.g[:, None, :] / self.rest[:, None, None]
        return self.m @ inner @ self.m.swapaxes(1, 2) / self.rest[:, None, None]

    @property
    def factor(self) -> Array:
        """(N,) sqrt(|V| / |V + cutoff^2 H|), what EWA's convolution leaves of the peak."""
        det = self.det_m**2 / self.rest**3
        filtered = self.variance + np.eye(2) * self.low_pass
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            return np.sqrt(det / (filtered[:, 0, 0] * filtered[:, 1, 1] - filtered[:, 0, 1] ** 2))


def _ellipses(projected: ProjectedSplats, discs: _Discs, camera: Camera, settings: RenderSettings) -> _Ellipses:
    """Return each splat's ellipse: of the affine map exact at the centre (Heckbert), or of the projected contour.

    Over the plane's points w = (u, v) den the ray meets the disc where |w| <= den, den = 1 + g.w ([ZRB04] section 3).
    """
    c, t_u, t_v = projected.center_eye, projected.tangent_u_eye, projected.tangent_v_eye
    cosine, cosine_scale = _cosine(c, t_u, t_v, camera)
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
        in_range = _range_margin(c[:, 2], np.abs(c[:, 2]) + TINY, camera)
    edge = (np.abs(cosine) - EDGE_ON) / (UNIT * cosine_scale)
    margin = np.minimum(np.minimum(in_range, edge), np.minimum(whole, projected.facing_margin))
    usable = (in_range >= 0) & (edge > 0) & (whole > 0) & ~projected.culled
    low_pass = (settings.cutoff * settings.prefilter_radius) ** 2 if settings.prefilter == "ewa" else 0.0
    g = np.where(usable[:, None], g, 0.0)
    return _Ellipses(_raster(center, camera), m, g, low_pass, usable, margin, discs.kappa)


def _within(ellipses: _Ellipses, filtered: bool, camera: Camera, s: Array) -> tuple[Array, Array]:
    """r^2 of a pixel in the ellipse, +inf where there is none, and the signed margin of r^2 <= 1.

    `filtered` by the low-pass filter or not; `s` as for `_intersect`. The margin's scale: rounding of x by 2 pixels'
    2^-24, of the ellipse's short axis by 1 + kappa (less where the low-pass filter widens it), of the products that r
    is a sum of. What is farther away than the long axis is outside, whatever the short one is.
    """
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        x, y = np.moveaxis(_raster(s, camera) - ellipses.center, -1, 0)
        (a, b), (c, d) = ellipses.m[:, 0].T, ellipses.m[:, 1].T
        middle, g, rest = ellipses.middle, ellipses.g, ellipses.rest
        x, y = x - (a * middle[:, 0] + b * middle[:, 1]), y - (c * middle[:, 0] + d * middle[:, 1])
        if filtered and ellipses.low_pass:
            v = ellipses.variance + np.eye(2) * ellipses.low_pass
            xx, xy, yy = v[:, 0, 0], v[:, 0, 1], v[:, 1, 1]
            det = xx * yy - xy * xy
            r_squared = (yy * x**2 - 2 * xy * x * y + xx * y**2) / det
            along = (np.sqrt(yy) * np.abs(x) + np.sqrt(xx) * np.abs(y)) / np.sqrt(det)
            thin = np.sqrt((xx + yy) / det)
            steep, size = 1 + ellipses.kappa * ellipses.factor**2, np.sqrt(xx + yy)
        else:
            det = ellipses.det_m
            p, q = (d * x - b * y) / det, (a * y - c * x) / det
            r_squared = (p**2 + q**2 - (g[:, 0] * p + g[:, 1] * q) ** 2) * rest
            along = ((np.abs(c) + np.abs(d)) * np.abs(x) + (np.abs(a) + np.abs(b)) * np.abs(y)) / np.abs(det)
            thin = (np.abs(a) + np.abs(b) + np.abs(c) + np.abs(d)) / np.abs(det)
            steep, size = 1 + ellipses.kappa, np.sqrt(ellipses.variance.trace(axis1=1, axis2=2))
        r = np.sqrt(r_squared)
        margin = (1 - r) / (UNIT * (steep * r + 4 * along + OFFSET_ERROR * thin))
        away = np.hypot(x, y) / size  # r is at least that
        margin = np.where(away > 1, np.fmin(margin, (1 - away) / (UNIT * (4 * away + OFFSET_ERROR / size))), margin)
        margin = np.fmin(margin, ellipses.usable_margin)
    return np.where(ellipses.usable, np.nan_to_num(r_squared, nan=np.inf), np.inf), np.nan_to_num(margin, nan=-np.inf)


def _footprint(
    hits: _Hits, ellipses: _Ellipses, filtered: bool, center_z: Array, camera: Camera, s: Array
) -> tuple[Array, Array, Array, Array]:
    """r^2 in the ellipse, the depth and its scale, and the margin (unsigned) of all that this took.

    A fragment whose ray misses the disc takes the centre's depth.
    """
    r_squared, margin = _within(ellipses, filtered, camera, s)
    disc = hits.r_squared <= 1
    z = np.where(disc, hits.z, center_z)
    scale_z = np.where(disc, hits.scale_z, np.abs(center_z) + TINY)
    covers = hits.kept & (r_squared <= 1)
    decided = np.where(margin > -64, np.minimum(np.abs(margin), np.abs(hits.kept_margin)), np.abs(margin))
    decided = np.where(covers | (margin > -64), np.minimum(decided, np.abs(hits.margin)), decided)
    return np.where(covers, r_squared, np.inf), z, scale_z, decided
