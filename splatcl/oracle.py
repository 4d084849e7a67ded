"""The passes in float64 NumPy, written from docs/specification.md: every splat against every pixel, no tiles.

An independent second opinion for the kernels (preset botsch05): slow, plain, sharing no code with them.

The margin
----------
Where a decision is nearly a tie, a float32 renderer may decide it otherwise than this one. Each decision has
a signed margin, (distance from flipping) / (2^-24 scale), positive where it accepts; `scale` is, to first
order, the rounding error of a float32 evaluation relative to the projected centre, in units of 2^-24. With
s = ((x-cx)/fx, (y-cy)/fy, 1), s_c the same at the projected centre, e_i = |s_i - s_c,i| + 2 pixels (whose
rounding error is 2^-24 e_i), den = g.s / g.s_c, A = a / g.s_c, B = b / g.s_c and G = g / g.s_c:

- r3^2 <= 1 and z > 0:  den - |(A.s, B.s)| >= 0, scale sum_i (|A_i| + |B_i| + |G_i|) e_i + 1 + kappa;
- near <= z <= far:  scale_z = |z| (1 + (1 + kappa) sum_i |G_i| e_i) / |den|
  (orthographic: |z| + (1 + kappa) sum_i |g_i / g_z| e_i), and |z| for the centre's z;
- r2^2 <= 1:  scale 2 r2^2 + 4 r2 (error of the pre-filter's centre in 2^-24 pixels) / prefilter_radius;
- z <= depth + epsilon:  scale_z of the fragment, plus that of the front-most splat, plus epsilon;
- which splat is front-most:  the difference of the two z, scale the sum of their scale_z;
- facing (cos = n.c / |c|, n_z if orthographic) and edge-on (|cos| - 2^-16):  scale
  4 |t_u| |t_v| / |t_u x t_v|;

kappa = max(|t_u|, |t_v|)^2 / |t_u x t_v| / |cos| is the relative error of g.s_c (of a circle, 1/|cos|).
Conditions that hold together (r3^2 <= 1, z in [near, far], not edge-on, not culled) have the least of their
signed margins, so a splat lowers the margin only of pixels that it touches or nearly touches; a disc wholly and
clearly outside [near, far] lowers none.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splatcl.camera import Camera
from splatcl.lights import Light
from splatcl.settings import RenderSettings
from splatcl.splats import Splats

Array = NDArray[Any]
UNIT = 2.0**-24
"""Half a float32 ulp of 1: the unit of every scale."""
EDGE_ON = 2.0**-16
"""|cos| between a splat's normal and the line to its centre up to which its disc is not intersected."""
OFFSET_ERROR = 2.0
"""Error of a pixel's offset from a projected centre, 2^-24 pixels."""
TINY = np.finfo(np.float64).tiny
"""Least scale, so that an exact tie has margin 0 even at z = 0."""
CLEAR = 1e-4
"""Bounds are infinite for a disc whose least z is not above this share of its centre's."""
NO_SPLAT = np.uint32(0xFFFFFFFF)
NOTHING = (np.inf, np.inf, -np.inf, -np.inf)
"""Bounds that cover nothing."""
PAIRS_AT_ONCE = 2**18
"""Splat-pixel pairs held in memory together."""


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


def auto_epsilon(splats: Splats) -> float:
    """Return the median of max(|t_u|, |t_v|), scene units; 0 for no splats."""
    return float(np.median(splats.radius)) if len(splats) else 0.0


def project(splats: Splats, camera: Camera, settings: RenderSettings) -> ProjectedSplats:
    """Move splats to eye space, decide their facing and bound their projections."""
    facing = settings.facing if splats.oriented else "flip"
    rotation, translation = camera.eye_from_world[:3, :3], camera.eye_from_world[:3, 3]
    center = splats.center.astype(np.float64) @ rotation.T + translation
    t_u = splats.tangent_u.astype(np.float64) @ rotation.T
    t_v = splats.tangent_v.astype(np.float64) @ rotation.T
    normal = _normalize(np.cross(t_u, t_v))
    cosine, cosine_scale = _cosine(center, t_u, t_v, camera)
    away = cosine >= 0
    culled = away & (facing == "cull")
    if facing == "flip":
        normal = np.where(away[:, None], -normal, normal)
    facing_margin = np.where(culled, -1, 1) * np.abs(cosine) / (UNIT * cosine_scale)
    if facing == "keep":
        facing_margin = np.full(len(splats), np.inf)

    disc = _disc_bounds(center, t_u, t_v, camera)
    point, error = _prefilter_point(center, t_u, t_v, disc, camera, settings)
    present = _range_margin(center[:, 2], np.abs(center[:, 2]) + TINY, camera)
    present[(settings.prefilter == "none") | np.isnan(point).any(axis=1)] = -np.inf
    reach = np.hypot(t_u[:, 2], t_v[:, 2])
    unseen = (center[:, 2] + reach < camera.near) | (center[:, 2] - reach > camera.far)
    disc[unseen | (np.abs(cosine) <= EDGE_ON)] = NOTHING
    square = np.hstack([point - settings.prefilter_radius, point + settings.prefilter_radius])
    square[present < 0] = NOTHING
    bounds = np.hstack([np.minimum(disc, square)[:, :2], np.maximum(disc, square)[:, 2:]])
    bounds[culled] = NOTHING
    hidden = (center[:, 2:] <= 0) & (camera.projection == "perspective")
    center_raster = np.where(hidden, np.nan, _raster(_s_center(center, camera), camera))
    return ProjectedSplats(
        center, t_u, t_v, normal, center_raster, bounds, culled, facing_margin, point, error, present
    )


def bin(projected: ProjectedSplats, camera: Camera, tile_size: int) -> list[Array]:
    """Return, for each tile in row-major order, the increasing indices of the splats whose bounds reach it.

    A tile is reached where the bounds overlap the box of its pixels' centres, edges included.
    """
    x_min, y_min, x_max, y_max = projected.bounds.T
    tiles = []
    for y in range(0, camera.height, tile_size):
        for x in range(0, camera.width, tile_size):
            x_last, y_last = min(x + tile_size, camera.width) - 1, min(y + tile_size, camera.height) - 1
            inside_x = (x_max >= x + 0.5) & (x_min <= x_last + 0.5)
            inside_y = (y_max >= y + 0.5) & (y_min <= y_last + 0.5)
            tiles.append(np.flatnonzero(inside_x & inside_y))
    return tiles


def visibility(projected: ProjectedSplats, camera: Camera, settings: RenderSettings) -> DepthBuffer:
    """Find the front-most disc at each pixel: depth = min z over r3 <= 1; ties go to the lower index."""
    del settings  # the pre-filter and the facing (already in `projected`) take no part
    num_pixels = camera.height * camera.width
    depth, margin, id_margin = (np.full(num_pixels, np.inf) for _ in range(3))
    particleid = np.full(num_pixels, NO_SPLAT)
    discs = _discs(projected, camera)
    for pixels, s in _chunks(camera, len(projected.center_eye)):
        hits = _intersect(discs, camera, s[:, None])
        z = np.where(hits.r_squared <= 1, hits.z, np.inf)
        front = z.argmin(axis=1, keepdims=True)
        nearest = np.take_along_axis(z, front, axis=1)
        depth[pixels] = nearest[:, 0]
        particleid[pixels] = np.where(np.isfinite(nearest), front, NO_SPLAT)[:, 0]
        margin[pixels] = np.abs(hits.margin).min(axis=1)
        with np.errstate(invalid="ignore", over="ignore"):
            gap = (z - nearest) / (UNIT * (hits.scale_z + np.take_along_axis(hits.scale_z, front, axis=1)))
        gap[z == np.inf] = np.inf
        np.put_along_axis(gap, front, np.inf, axis=1)
        id_margin[pixels] = gap.min(axis=1)
    buffers = (depth, particleid, np.minimum(margin, id_margin), margin)
    return DepthBuffer(*(_image(buffer, camera) for buffer in buffers))


def attributes(
    projected: ProjectedSplats,
    depth: DepthBuffer,
    camera: Camera,
    settings: RenderSettings,
    epsilon: float,
    color: Array,
) -> GBuffer:
    """Accumulate every fragment with r^2 = min(r3^2, r2^2) <= 1 and z <= depth + epsilon.

    `epsilon` is in scene units, along eye z or the ray (`settings.along`); `color` is (N, 3) linear RGB.
    """
    num_pixels = camera.height * camera.width
    sums = np.zeros((num_pixels, 8))  # w, w color, w normal, w z
    count = np.zeros(num_pixels, np.uint32)
    margin = np.full(num_pixels, np.inf)
    discs = _discs(projected, camera)
    z_center = projected.center_eye[:, 2]
    values = np.column_stack([np.ones(len(color)), color.astype(np.float64), projected.normal_eye])
    for pixels, s in _chunks(camera, len(z_center)):
        hits = _intersect(discs, camera, s[:, None])
        r2_squared, prefilter_margin = _prefilter(projected, camera, settings, s[:, None])
        r_squared = np.minimum(hits.r_squared, r2_squared)
        hit = hits.r_squared <= 1
        exists = r_squared <= 1
        z = np.where(hit, hits.z, z_center)
        scale_z = np.where(hit, hits.scale_z, np.abs(z_center) + TINY)
        tolerance = np.full((len(s), 1), epsilon)
        if settings.along == "ray":
            tolerance /= _ray_length(camera, s)[:, None]
        limit = depth.depth.reshape(-1, 1)[pixels] + tolerance
        accepted = exists & (z <= limit)
        weight = np.zeros(z.shape)
        weight[accepted] = _weight(r_squared[accepted], settings)
        sums[pixels, :7] = np.einsum("pn,nk->pk", weight, values)
        sums[pixels, 7] = np.einsum("pn,pn->p", weight, z)
        count[pixels] = accepted.sum(axis=1)

        prefilter_margin = np.where(hit, np.inf, np.abs(prefilter_margin))
        front = depth.particleid.reshape(-1, 1)[pixels]
        front_scale_z = np.take_along_axis(scale_z, np.where(front == NO_SPLAT, 0, front).astype(np.int64), axis=1)
        depth_margin = _depth_margin(limit - z, scale_z, front_scale_z, front == np.arange(len(color)), tolerance)
        depth_margin = np.where(exists, depth_margin, np.inf)
        margins = np.minimum(np.minimum(np.abs(hits.margin), prefilter_margin), depth_margin)
        margin[pixels] = margins.min(axis=1)
    columns = (sums[:, 0], sums[:, 1:4], sums[:, 4:7], sums[:, 7], count, margin)
    return GBuffer(*(_image(column, camera) for column in columns))


def shade(gbuffer: GBuffer, depth: DepthBuffer, camera: Camera, settings: RenderSettings) -> dict[str, Array]:
    """Resolve the G-buffer and light each pixel once.

    Returns
    -------
    dict
        `color` (H, W, 4) linear RGBA; `P`, `N` (H, W, 3) eye space; `albedo` (H, W, 3);
        `depth.mean`, `depth.distance` (H, W) scene units, +inf where there is nothing.
    """
    s = _image(_rays(camera), camera)
    covered = gbuffer.weight_sum > 0
    weight_sum = np.where(covered, gbuffer.weight_sum, 1.0)
    mean = np.where(covered, gbuffer.depth_sum / weight_sum, np.inf)
    albedo = gbuffer.color_sum / weight_sum[..., None]
    normal = _normalize(gbuffer.normal_sum)
    z = np.where(np.isfinite(depth.depth), depth.depth, mean)
    z_covered = np.where(covered, z, 0.0)[..., None]
    if camera.projection == "perspective":
        position = z_covered * s
        to_eye = _normalize(-position)
    else:
        position = np.where(covered[..., None], np.concatenate([s[..., :2], z_covered], axis=-1), 0.0)
        to_eye = np.broadcast_to([0.0, 0.0, -1.0], s.shape)
    if settings.shader == "albedo":
        rgb = albedo
    elif settings.shader == "normal":
        rgb = 0.5 + 0.5 * normal * (1.0, -1.0, -1.0)
    else:
        rgb = _phong(position, normal, albedo, to_eye, camera, settings)
    rgba = np.concatenate([rgb, np.ones((*covered.shape, 1))], axis=-1)
    return {
        "color": np.where(covered[..., None], rgba, 0.0),
        "P": position,
        "N": normal,
        "albedo": albedo,
        "depth.mean": mean,
        "depth.distance": z * _ray_length(camera, s),
    }


def passes(splats: Splats, camera: Camera, settings: RenderSettings, epsilon: float) -> dict[str, Array]:
    """Run all passes; return what `render` does, but with two margins.

    `margin` leaves out which of several splats is front-most (coplanar ones tie everywhere); `id_margin` is of the
    visibility pass, that included. `epsilon` is in scene units.
    """
    projected = project(splats, camera, settings)
    depth = visibility(projected, camera, settings)
    gbuffer = attributes(projected, depth, camera, settings, epsilon, splats.color)
    return {
        **shade(gbuffer, depth, camera, settings),
        "Z": depth.depth,
        "weight": gbuffer.weight_sum,
        "count": gbuffer.count,
        "particleid": depth.particleid,
        "margin": np.minimum(depth.depth_margin, gbuffer.margin),
        "id_margin": depth.margin,
    }


def render(splats: Splats, camera: Camera, settings: RenderSettings) -> dict[str, Array]:
    """Run all passes; return the image and its AOVs, each (H, W) or (H, W, channels)."""
    aovs = passes(splats, camera, settings, auto_epsilon(splats) if settings.epsilon == "auto" else settings.epsilon)
    aovs["margin"] = np.minimum(aovs["margin"], aovs.pop("id_margin"))
    return aovs


# ---- rays and projections


def _rays(camera: Camera) -> Array:
    """(H W, 3) s = ((x-cx)/fx, (y-cy)/fy, 1) of the pixel centres: a perspective ray is z s, z = depth."""
    x, y = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    s = np.stack([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, np.ones(x.shape)], axis=-1)
    return s.reshape(-1, 3)


def _chunks(camera: Camera, num_splats: int) -> Iterator[tuple[slice, Array]]:
    """Yield pixel ranges and their (P, 3) s, so that P num_splats stays bounded; nothing for no splats."""
    s = _rays(camera)
    step = max(1, PAIRS_AT_ONCE // max(num_splats, 1))
    for start in range(0, len(s) if num_splats else 0, step):
        yield slice(start, start + step), s[start : start + step]


def _image(column: Array, camera: Camera) -> Array:
    """(H W, ...) -> (H, W, ...)."""
    return column.reshape(camera.height, camera.width, *column.shape[1:])


def _ray_length(camera: Camera, s: Array) -> Array:
    """Distance along the ray per unit of eye z."""
    return np.linalg.norm(s, axis=-1) if camera.projection == "perspective" else np.ones(s.shape[:-1])


def _s_center(center: Array, camera: Camera) -> Array:
    with np.errstate(divide="ignore", invalid="ignore"):
        return center[:, :2] / center[:, 2:] if camera.projection == "perspective" else center[:, :2]


def _raster(s: Array, camera: Camera) -> Array:
    return s[..., :2] * (camera.fx, camera.fy) + (camera.cx, camera.cy)


def _normalize(vector: Array) -> Array:
    """Return unit vectors; zero stays zero."""
    length = np.linalg.norm(vector, axis=-1, keepdims=True)
    return vector / np.where(length > 0, length, 1.0)


def _cosine(center: Array, t_u: Array, t_v: Array, camera: Camera) -> tuple[Array, Array]:
    """(N,) cos = n.c / |c|, or n_z if orthographic: >= 0 faces away, 0 is edge-on; (N,) its scale."""
    g = np.cross(t_u, t_v)
    toward = _normalize(center) if camera.projection == "perspective" else np.array([0.0, 0.0, 1.0])
    scale = 4 * np.linalg.norm(t_u, axis=1) * np.linalg.norm(t_v, axis=1) / np.linalg.norm(g, axis=1)
    return (_normalize(g) * toward).sum(axis=1), scale


def _disc_bounds(center: Array, t_u: Array, t_v: Array, camera: Camera) -> Array:
    """(N, 4) bounds of the whole discs' projections, pixels; infinite where one is not clear of the eye plane.

    With t_x = (t_u,x, t_v,x) and t_z alike, the plane x = s z touches the disc where
    |t_x - s t_z|^2 = (c_x - s c_z)^2, a quadratic in s; the same for y.
    """
    t = np.stack([t_u, t_v], axis=-1)  # (N, 3, 2)
    t_xy, t_z, c_xy, c_z = t[:, :2], t[:, 2:], center[:, :2], center[:, 2:]
    if camera.projection == "orthographic":
        half = np.linalg.norm(t_xy, axis=2)
        low, high = c_xy - half, c_xy + half
    else:
        p = (t_z**2).sum(axis=2) - c_z**2  # < 0 where the disc stays clear of the eye plane
        q = (t_xy * t_z).sum(axis=2) - c_xy * c_z
        g_yx = t[:, :2, 0] * t[:, 2:, 1] - t[:, :2, 1] * t[:, 2:, 0]
        root = np.sqrt(np.maximum(((c_z[..., None] * t_xy - c_xy[..., None] * t_z) ** 2).sum(axis=2) - g_yx**2, 0))
        clear = c_z - np.linalg.norm(t_z, axis=2) > CLEAR * c_z
        with np.errstate(divide="ignore", invalid="ignore"):
            low = np.where(clear, (q + root) / p, -np.inf)
            high = np.where(clear, (q - root) / p, np.inf)
    return np.concatenate([_raster(low, camera), _raster(high, camera)], axis=1)


def _prefilter_point(
    center: Array, t_u: Array, t_v: Array, disc: Array, camera: Camera, settings: RenderSettings
) -> tuple[Array, Array]:
    """(N, 2) the projected centre, or the bounds' (NaN if infinite); (N,) its error, 2^-24 pixels."""
    raster = _raster(_s_center(center, camera), camera)
    error = np.full(len(center), OFFSET_ERROR)
    if settings.prefilter_center == "projected":
        return raster, error
    z, reach = center[:, 2] ** 2, t_u[:, 2] ** 2 + t_v[:, 2] ** 2
    with np.errstate(invalid="ignore", divide="ignore"):
        middle = (disc[:, :2] + disc[:, 2:]) / 2
        return middle, error + np.abs(middle - raster).sum(axis=1) * (z + reach) / np.abs(z - reach)


# ---- splat against pixel


@dataclass(frozen=True, eq=False)
class _Discs:
    """Per splat: u = U.s / D.s, v = V.s / D.s, z = Z.s / D.s at the pixel s; D.s > 0 where z has its sign."""

    forms: Array  # (4, 3, N): U, V, Z, D
    s_center: Array  # (N, 2) s at the projected centre
    d_center: Array  # (N,) |D.s| there
    kappa: Array  # (N,)
    usable: Array  # (N,) bool: neither edge-on nor culled
    usable_margin: Array  # (N,) signed
    offset_error: float = OFFSET_ERROR  # of a pixel's offset from the projected centre, 2^-24 pixels


@dataclass(frozen=True, eq=False)
class _Hits:
    """Arrays are (P, N), or (N,) for one pixel each."""

    r_squared: Array  # r3^2; +inf where the disc is missed or z is out of range
    r: Array  # of the plane's point, whether or not it counts
    z: Array  # meaningful where r_squared <= 1
    scale_z: Array
    scale_r: Array  # of den - |(A.s, B.s)|, over den: of r3
    margin: Array  # signed


def _discs(projected: ProjectedSplats, camera: Camera) -> _Discs:
    """Write the intersection as quotients of linear forms in s.

    Perspective: c + u t_u + v t_v = z s gives u = a.s/g.s, v = b.s/g.s, z = c.g/g.s with a = t_v x c,
    b = c x t_u, g = t_u x t_v. Orthographic: the same with the ray (s_x, s_y, 0) + z (0, 0, 1), that is with
    c - (s_x, s_y, 0) for c and (0, 0, 1) for the direction.
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
    cosine, cosine_scale = _cosine(c, t_u, t_v, camera)
    cosine = np.abs(cosine)
    longest = np.maximum((t_u**2).sum(axis=1), (t_v**2).sum(axis=1))
    with np.errstate(divide="ignore", invalid="ignore"):
        d_center = np.abs(c_g / c[:, 2]) if camera.projection == "perspective" else np.abs(g[:, 2])
        kappa = longest / np.linalg.norm(g, axis=1) / cosine
    usable_margin = np.minimum((cosine - EDGE_ON) / (UNIT * cosine_scale), projected.facing_margin)
    usable_margin[_out_of_range(projected, camera)] = -np.inf
    usable = (cosine > EDGE_ON) & ~projected.culled
    return _Discs(forms, _s_center(c, camera), d_center, kappa, usable, usable_margin)


def _out_of_range(projected: ProjectedSplats, camera: Camera) -> Array:
    """(N,) whether the whole disc is outside [near, far] by over a thousandth of its distance."""
    z, reach = projected.center_eye[:, 2], np.hypot(projected.tangent_u_eye[:, 2], projected.tangent_v_eye[:, 2])
    clearly = 1e-3 * (np.linalg.norm(projected.center_eye, axis=1) + reach)
    return (z + reach + clearly < camera.near) | (z - reach - clearly > camera.far)


def _intersect(discs: _Discs, camera: Camera, s: Array) -> _Hits:
    """Intersect pixels' rays with discs; `s` is (P, 1, 3) for all (N,) discs each, or (N, 3) for one each."""
    s_x, s_y = s[..., 0], s[..., 1]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        u, v, z, d = (s_x * x + s_y * y + one for x, y, one in discs.forms)
        size = np.sqrt(u**2 + v**2)
        z /= d
        hit = discs.usable & (d > 0) & (z >= camera.near) & (z <= camera.far)
        r_squared = np.where(hit, (size / d) ** 2, np.inf)

        e_x = np.abs(s_x - discs.s_center[:, 0]) + discs.offset_error / camera.fx
        e_y = np.abs(s_y - discs.s_center[:, 1]) + discs.offset_error / camera.fy
        u_abs, v_abs, z_abs, d_abs = np.abs(discs.forms)
        uvd_abs, steep = u_abs + v_abs + d_abs, 1 + discs.kappa
        scale_r = uvd_abs[0] * e_x + uvd_abs[1] * e_y + steep * discs.d_center
        error_d = discs.d_center + steep * (d_abs[0] * e_x + d_abs[1] * e_y)
        error_z = steep * (z_abs[0] * e_x + z_abs[1] * e_y)
        scale_z = (np.abs(z) * error_d + error_z) / np.abs(d) + TINY
        margin = np.fmin((d - size) / (UNIT * scale_r), _range_margin(z, scale_z, camera))
        scale_r /= np.abs(d)
        r = size / np.abs(d)
    return _Hits(r_squared, r, z, scale_z, scale_r, np.fmin(margin, discs.usable_margin))


def _range_margin(z: Array, scale: Array, camera: Camera) -> Array:
    """Signed margin of near <= z <= far; NaN where z or its scale is not known."""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        return np.minimum(z - camera.near, camera.far - z) / (UNIT * scale)


def _prefilter(projected: ProjectedSplats, camera: Camera, settings: RenderSettings, s: Array) -> tuple[Array, Array]:
    """r2^2 = |p - p_c|^2 / prefilter_radius^2, +inf for no pre-filter; its signed margin. `s` as for `_intersect`."""
    radius = settings.prefilter_radius
    p = _raster(s, camera)
    x, y = projected.prefilter_point.T
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        r_squared = ((p[..., 0] - x) ** 2 + (p[..., 1] - y) ** 2) / radius**2
        scale = 2 * r_squared + 4 * np.sqrt(r_squared) * projected.prefilter_error / radius
        margin = np.fmin((1 - r_squared) / (UNIT * scale), projected.facing_margin)
    present = (projected.prefilter_margin >= 0) & ~projected.culled
    return np.where(present, r_squared, np.inf), np.fmin(margin, projected.prefilter_margin)


def _depth_margin(slack: Array, scale_z: Array, front_scale_z: Array, is_front: Array, tolerance: Array) -> Array:
    """Margin of z <= depth + epsilon, +inf for the front-most splat itself and where no disc was hit."""
    with np.errstate(invalid="ignore", over="ignore"):
        margin = np.abs(slack) / (UNIT * (scale_z + front_scale_z + tolerance))
    return np.where(is_front | (slack == np.inf), np.inf, margin)


def _weight(r_squared: Array, settings: RenderSettings) -> Array:
    """Weight at r^2 <= 1."""
    if settings.kernel == "constant":
        return np.ones(r_squared.shape)
    if settings.kernel == "gaussian":
        return np.exp(-(settings.cutoff**2) * r_squared / 2)
    table = np.asarray(settings.kernel_table)
    position = np.sqrt(r_squared) * (len(table) - 1)
    if settings.kernel_lookup == "nearest":
        return table[np.floor(position + 0.5).astype(np.int64)]
    return np.interp(position, np.arange(len(table)), table)


def _phong(
    position: Array, normal: Array, albedo: Array, to_eye: Array, camera: Camera, settings: RenderSettings
) -> Array:
    """(H, W, 3) albedo (ambient + diffuse sum max(N.L, 0)) + specular sum max(R.V, 0)^shininess."""
    material = settings.material
    diffuse, specular = np.zeros(normal.shape), np.zeros(normal.shape)
    for light in settings.lights:
        to_light = _to_light(light, position, to_eye, camera)
        n_l = (normal * to_light).sum(axis=-1, keepdims=True)
        mirrored = 2 * n_l * normal - to_light
        r_v = np.maximum((mirrored * to_eye).sum(axis=-1, keepdims=True), 0.0)
        diffuse += np.maximum(n_l, 0.0) * light.color
        specular += np.where(n_l > 0, r_v**material.shininess, 0.0) * light.color
    return albedo * (material.ambient + material.diffuse * diffuse) + material.specular * specular


def _to_light(light: Light, position: Array, to_eye: Array, camera: Camera) -> Array:
    """(H, W, 3) unit eye-space vectors toward the light; a headlight's go where the eye is."""
    if light.kind == "headlight":
        return to_eye
    vector = camera.eye_from_world[:3, :3] @ light.vector
    if light.kind == "directional":
        return np.broadcast_to(_normalize(vector), position.shape)
    return _normalize(vector + camera.eye_from_world[:3, 3] - position)
