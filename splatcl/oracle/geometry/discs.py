"""Discs: where rays meet them, and the margins of these decisions.

The math is that of [BHZK05]'s ray casting, for a splat c + u t_u + v t_v with u^2 + v^2 <= 1 (docs/specification.md).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from splatcl.oracle.buffers import Array, ProjectedSplats
from splatcl.oracle.geometry.rays import (
    CLEAR,
    EDGE_ON,
    OFFSET_ERROR,
    TINY,
    UNIT,
    facing_cosine,
    range_margin,
    to_image_plane,
    to_raster,
)
from splatcl.scene.camera import Camera


@dataclass(frozen=True, eq=False)
class Discs:
    """Linear forms of N discs: at s, u = U.s / D.s, v = V.s / D.s and z = Z.s / D.s.

    D.s > 0 where z > 0 under perspective, and for every orthographic ray.
    """

    forms: Array  # (4, 3, N) U, V, Z, D
    s_center: Array  # (N, 2) s of the projected center
    d_center: Array  # (N,) |D.s| there
    kappa: Array  # (N,) relative error of g.s at the center (splatcl/oracle/__init__.py)
    usable: Array  # (N,) bool: neither edge-on nor culled
    usable_margin: Array  # (N,) signed
    edge_margin: Array  # (N,) signed, of not being edge-on
    clips: Array  # (2, 3, N) forms of the clip lines, which keep a pixel where they are >= 0; zeros for no line
    offset_error: float = OFFSET_ERROR  # of a pixel's offset from the projected center, 2^-24 pixels

    @classmethod
    def of(cls, projected: ProjectedSplats, camera: Camera) -> Discs:
        """Write the intersection of ray and plane as quotients of linear forms in s.

        Perspective: c + u t_u + v t_v = z s gives u = a.s / g.s, v = b.s / g.s, z = c.g / g.s with a = t_v x c,
        b = c x t_u, g = t_u x t_v. Orthographic: the ray is (s_x, s_y, 0) + z (0, 0, 1), so c - (s_x, s_y, 0) stands
        for c, and (0, 0, 1) for s in the dot products.
        """
        c, t_u, t_v = projected.center_eye, projected.tangent_u_eye, projected.tangent_v_eye
        a, b, g = np.cross(t_v, c), np.cross(c, t_u), np.cross(t_u, t_v)
        zero, c_g = np.zeros(len(c)), (c * g).sum(axis=1)
        if camera.projection == "perspective":
            forms = np.stack([a.T, b.T, [zero, zero, c_g], g.T]) * np.sign(c_g)
        else:
            form_u, form_v = [t_v[:, 1], -t_v[:, 0], a[:, 2]], [-t_u[:, 1], t_u[:, 0], b[:, 2]]
            form_z, form_d = [-g[:, 0], -g[:, 1], c_g], [zero, zero, g[:, 2]]
            forms = np.stack([form_u, form_v, form_z, form_d]) * np.sign(g[:, 2])
        cosine, cosine_scale = facing_cosine(c, t_u, t_v, camera)
        cosine = np.abs(cosine)
        longest = np.maximum((t_u**2).sum(axis=1), (t_v**2).sum(axis=1))
        with np.errstate(divide="ignore", invalid="ignore"):
            d_center = np.abs(c_g / c[:, 2]) if camera.projection == "perspective" else np.abs(g[:, 2])
            kappa = longest / np.linalg.norm(g, axis=1) / cosine
        edge_margin = (cosine - EDGE_ON) / (UNIT * cosine_scale)
        usable_margin = np.minimum(edge_margin, projected.facing_margin)
        usable_margin[out_of_range(projected, camera)] = -np.inf
        usable = (cosine > EDGE_ON) & ~projected.culled
        clips = np.einsum("nlk,kjn->ljn", projected.clip, forms[[0, 1, 3]])
        constant = np.stack([zero, zero, np.ones(len(c))])[None] * projected.clip[:, :, 2].T[:, None]
        clips = np.where(cosine > EDGE_ON, clips, constant)  # an edge-on disc is on the side of its center
        return cls(forms, to_image_plane(c, camera), d_center, kappa, usable, usable_margin, edge_margin, clips)


@dataclass(frozen=True, eq=False)
class Hits:
    """Rays against discs: arrays are (P, N) for P pixels and N discs, or (N,) for one pixel each."""

    r_squared: Array  # r3^2; +inf where the disc is missed, clipped, or z is outside [near, far]
    r: Array  # sqrt(u^2 + v^2) of the ray's point on the plane, hit or not
    z: Array  # eye z of that point, scene units; meaningful where r_squared <= 1
    scale_z: Array  # rounding error of z, 2^-24 scene units
    scale_r: Array  # rounding error of r, 2^-24
    margin: Array  # signed, of the hit
    u: Array  # disc coordinates of that point
    v: Array
    kept: Array  # bool: no clip line cuts it off
    kept_margin: Array  # signed
    plane_margin: Array  # signed, of the plane's z in [near, far] and the disc not edge-on


def out_of_range(projected: ProjectedSplats, camera: Camera) -> Array:
    """Find the discs, (N,) bool, that lie outside [near, far] by over a thousandth of their distance."""
    z, reach = projected.center_eye[:, 2], np.hypot(projected.tangent_u_eye[:, 2], projected.tangent_v_eye[:, 2])
    clearly = 1e-3 * (np.linalg.norm(projected.center_eye, axis=1) + reach)
    return (z + reach + clearly < camera.near) | (z - reach - clearly > camera.far)


def intersect(discs: Discs, camera: Camera, s: Array) -> Hits:
    """Intersect pixels' rays with discs; `s` is (P, 1, 3) to pair each pixel with all discs, (N, 3) with one each."""
    s_x, s_y = s[..., 0], s[..., 1]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        u, v, z, d = (s_x * x + s_y * y + one for x, y, one in discs.forms)
        size = np.sqrt(u**2 + v**2)
        z /= d
        kept, kept_margin = _clip(discs, camera, s)
        hit = discs.usable & (d > 0) & (z >= camera.near) & (z <= camera.far) & kept
        r_squared = np.where(hit, (size / d) ** 2, np.inf)

        scale_r, e_x, e_y = _scale(discs, camera, s)
        _, _, z_abs, d_abs = np.abs(discs.forms)
        steep = 1 + discs.kappa
        error_d = discs.d_center + steep * (d_abs[0] * e_x + d_abs[1] * e_y)
        error_z = steep * (z_abs[0] * e_x + z_abs[1] * e_y)
        scale_z = (np.abs(z) * error_d + error_z) / np.abs(d) + TINY
        in_range = range_margin(z, scale_z, camera)
        margin = np.fmin((d - size) / (UNIT * scale_r), in_range)
        scale_r /= np.abs(d)
        r = size / np.abs(d)
        margin = np.fmin(np.fmin(margin, discs.usable_margin), kept_margin)
        plane_margin = np.minimum(in_range, discs.edge_margin)
        return Hits(r_squared, r, z, scale_z, scale_r, margin, u / d, v / d, kept, kept_margin, plane_margin)


def _scale(discs: Discs, camera: Camera, s: Array) -> tuple[Array, Array, Array]:
    """Return the scale of D.s - |(U.s, V.s)| and of a clip line's form, then e_x and e_y; `s` as for `intersect`."""
    e_x = np.abs(s[..., 0] - discs.s_center[:, 0]) + discs.offset_error / camera.fx
    e_y = np.abs(s[..., 1] - discs.s_center[:, 1]) + discs.offset_error / camera.fy
    u_abs, v_abs, _, d_abs = np.abs(discs.forms)
    terms = u_abs + v_abs + d_abs
    return terms[0] * e_x + terms[1] * e_y + (1 + discs.kappa) * discs.d_center, e_x, e_y


def _clip(discs: Discs, camera: Camera, s: Array) -> tuple[Array, Array]:
    """Return whether the clip lines keep each pixel, and the signed margin of that; `s` as for `intersect`."""
    s_x, s_y = s[..., 0], s[..., 1]
    shape = np.broadcast_shapes(s_x.shape, discs.kappa.shape)
    kept, margin = np.ones(shape, bool), np.full(shape, np.inf)
    if not discs.clips.any():
        return kept, margin
    with np.errstate(invalid="ignore", over="ignore"):
        scale, _, _ = _scale(discs, camera, s)
        for line in discs.clips:
            side = s_x * line[0] + s_y * line[1] + line[2]
            cuts = line.any(axis=0)
            kept = kept & (~cuts | (side >= 0))
            margin = np.fmin(margin, np.where(cuts, side / (UNIT * scale), np.inf))
    return kept, margin


def disc_bounds(center: Array, t_u: Array, t_v: Array, camera: Camera) -> Array:
    """Bound the projected discs: (N, 4) x_min y_min x_max y_max, pixels; infinite unless `CLEAR` of the eye plane.

    `center`, `t_u` and `t_v` are (N, 3) in eye space. With t_x = (t_u,x, t_v,x) and t_z alike, the plane x = s z
    touches the disc where |t_x - s t_z|^2 = (c_x - s c_z)^2. This is a quadratic equation in s; y has the same one.
    """
    t = np.stack([t_u, t_v], axis=-1)  # (N, 3, 2)
    t_xy, t_z, c_xy, c_z = t[:, :2], t[:, 2:], center[:, :2], center[:, 2:]
    if camera.projection == "orthographic":
        half = np.linalg.norm(t_xy, axis=2)
        low, high = c_xy - half, c_xy + half
    else:
        p = (t_z**2).sum(axis=2) - c_z**2  # < 0 for a disc clear of the eye plane
        q = (t_xy * t_z).sum(axis=2) - c_xy * c_z
        g_yx = t[:, :2, 0] * t[:, 2:, 1] - t[:, :2, 1] * t[:, 2:, 0]
        root = np.sqrt(np.maximum(((c_z[..., None] * t_xy - c_xy[..., None] * t_z) ** 2).sum(axis=2) - g_yx**2, 0))
        clear = c_z - np.linalg.norm(t_z, axis=2) > CLEAR * c_z
        with np.errstate(divide="ignore", invalid="ignore"):
            low = np.where(clear, (q + root) / p, -np.inf)
            high = np.where(clear, (q - root) / p, np.inf)
    return np.concatenate([to_raster(low, camera), to_raster(high, camera)], axis=1)
