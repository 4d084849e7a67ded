"""The visibility and the attribute pass: every splat against every pixel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from splatcl.camera import Camera
from splatcl.oracle.discs import _discs, _intersect
from splatcl.oracle.project import ProjectedSplats
from splatcl.oracle.rays import NO_SPLAT, TINY, UNIT, Array, _chunks, _image, _raster, _ray_length
from splatcl.settings import RenderSettings


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
