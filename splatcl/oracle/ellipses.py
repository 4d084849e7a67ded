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
    """Per splat the ellipse x^T V^-1 x <= 1 about `center`, and what EWA makes of it; pixels."""

    center: Array  # (N, 2) raster
    shape: Array  # (N, 2, 2) V: of the footprint, the contour r = 1
    filtered: Array  # (N, 2, 2) V + cutoff^2 H
    factor: Array  # (N,) sqrt(|V| / |V + cutoff^2 H|)
    usable: Array  # (N,) bool
    usable_margin: Array  # (N,) signed
    kappa: Array  # (N,)


def _ellipses(projected: ProjectedSplats, discs: _Discs, camera: Camera, settings: RenderSettings) -> _Ellipses:
    """Return each splat's ellipse: of the affine map exact at the centre, or of the projected contour.

    Both are images of the unit circle: J [t_u t_v] with J the projection's derivative at the centre (Heckbert), and
    the conic |(U.s, V.s)|^2 = (D.s)^2 ([ZRB04] section 3), whose centre is where its gradient vanishes.
    """
    c, t_u, t_v = projected.center_eye, projected.tangent_u_eye, projected.tangent_v_eye
    cosine, cosine_scale = _cosine(c, t_u, t_v, camera)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        if settings.footprint == "affine":
            center, shape = _affine(c, t_u, t_v, camera)
            whole = np.full(len(c), np.inf)
        else:
            center, shape = _conic(discs, camera)
            reach = np.hypot(t_u[:, 2], t_v[:, 2])
            whole = ((1 - CLEAR) * c[:, 2] - reach) / (UNIT * (4 * np.abs(c[:, 2]) + 4 * reach + TINY))
            if camera.projection == "orthographic":
                whole = np.full(len(c), np.inf)
        low_pass = np.eye(2) * (settings.cutoff * settings.prefilter_radius) ** 2
        filtered = shape + low_pass if settings.prefilter == "ewa" else shape
        factor = np.sqrt(np.linalg.det(shape) / np.linalg.det(filtered))
        in_range = _range_margin(c[:, 2], np.abs(c[:, 2]) + TINY, camera)
    edge = (np.abs(cosine) - EDGE_ON) / (UNIT * cosine_scale)
    margin = np.minimum(np.minimum(in_range, edge), np.minimum(whole, projected.facing_margin))
    usable = (in_range >= 0) & (edge > 0) & (whole > 0) & ~projected.culled
    return _Ellipses(center, shape, filtered, factor, usable, margin, discs.kappa)


def _affine(c: Array, t_u: Array, t_v: Array, camera: Camera) -> tuple[Array, Array]:
    """(N, 2) projected centres, (N, 2, 2) M M^T of the affine maps M from the unit disc to pixels."""
    t = np.stack([t_u, t_v], axis=-1)  # (N, 3, 2)
    focal = np.array([camera.fx, camera.fy])
    if camera.projection == "perspective":
        slope = c[:, :2] / c[:, 2:]
        m = (t[:, :2] - slope[..., None] * t[:, 2:]) / c[:, 2, None, None] * focal[:, None]
    else:
        slope = c[:, :2]
        m = t[:, :2] * focal[:, None]
    return _raster(slope, camera), m @ m.swapaxes(1, 2)


def _conic(discs: _Discs, camera: Camera) -> tuple[Array, Array]:
    """(N, 2) centres, (N, 2, 2) shapes of the conics x^T Q x = 0 over s, Q = U U^T + V V^T - D D^T."""
    u, v, _, d = discs.forms.swapaxes(1, 2)  # (N, 3) each
    d_center = np.where(discs.d_center > 0, discs.d_center, 1.0)[:, None]
    q = sum(sign * (f / d_center)[:, :, None] * (f / d_center)[:, None, :] for sign, f in ((1, u), (1, v), (-1, d)))
    usable = np.abs(np.linalg.det(q[:, :2, :2])) > 0
    square = np.where(usable[:, None, None], q[:, :2, :2], np.eye(2))
    center = -np.linalg.solve(square, q[:, :2, 2:])[:, :, 0]
    value = -(q[:, 2, 2] + (q[:, 2, :2] * center).sum(axis=1))
    focal = np.array([camera.fx, camera.fy])
    shape = np.linalg.inv(square) * value[:, None, None] * focal[:, None] * focal
    return center * focal + (camera.cx, camera.cy), shape


def _within(ellipses: _Ellipses, shape: Array, camera: Camera, s: Array) -> tuple[Array, Array]:
    """r^2 = x^T shape^-1 x of a pixel x, +inf where there is no ellipse, and the signed margin of r^2 <= 1.

    `s` as for `_intersect`. The margin's scale: rounding of x by 2 pixels' 2^-24 and of the shape by 1 + kappa.
    """
    x = _raster(s, camera) - ellipses.center
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        a, b, d = shape[:, 0, 0], shape[:, 0, 1], shape[:, 1, 1]
        det = np.linalg.det(shape)
        r_squared = (d * x[..., 0] ** 2 - 2 * b * x[..., 0] * x[..., 1] + a * x[..., 1] ** 2) / det
        r = np.sqrt(np.maximum(r_squared, 0))
        along = np.sqrt(d / det) * np.abs(x[..., 0]) + np.sqrt(a / det) * np.abs(x[..., 1])
        thin = np.sqrt((a + d) / det)  # about the inverse of the short half axis
        scale = (1 + ellipses.kappa) * (r + along) + OFFSET_ERROR * thin
        margin = np.fmin((1 - r) / (UNIT * scale), ellipses.usable_margin)
    return np.where(ellipses.usable, np.nan_to_num(r_squared, nan=np.inf), np.inf), np.nan_to_num(margin, nan=-np.inf)


def _footprint(
    hits: _Hits, ellipses: _Ellipses, filtered: bool, center_z: Array, camera: Camera, s: Array
) -> tuple[Array, Array, Array, Array]:
    """r^2 in the ellipse, the depth and its scale, and the margin (unsigned) of all that this took.

    A fragment whose ray misses the disc takes the centre's depth.
    """
    r_squared, margin = _within(ellipses, ellipses.filtered if filtered else ellipses.shape, camera, s)
    disc = hits.r_squared <= 1
    z = np.where(disc, hits.z, center_z)
    scale_z = np.where(disc, hits.scale_z, np.abs(center_z) + TINY)
    covers = hits.kept & (r_squared <= 1)
    decided = np.where(margin > -64, np.minimum(np.abs(margin), np.abs(hits.kept_margin)), np.abs(margin))
    decided = np.where(covers | (margin > -64), np.minimum(decided, np.abs(hits.margin)), decided)
    return np.where(covers, r_squared, np.inf), z, scale_z, decided
