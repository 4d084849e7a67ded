"""The visibility and the attribute pass: every splat against every pixel."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from splatcl.camera import Camera
from splatcl.oracle.geometry.discs import _Discs, _discs, _Hits, _intersect
from splatcl.oracle.geometry.ellipses import _Cover, _Ellipses, _ellipses, _within
from splatcl.oracle.geometry.rays import (
    NO_SPLAT,
    OFFSET_ERROR,
    TINY,
    UNIT,
    Array,
    _chunks,
    _image,
    _normalize,
    _raster,
    _ray_length,
)
from splatcl.oracle.project import ProjectedSplats
from splatcl.oracle.shade import shade_points
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
    channel_sum: Array | None = None  # (H, W, K)


@dataclass(frozen=True, eq=False)
class _Fragments:
    """Every pixel of a chunk against every splat, (P, N) each."""

    r_squared: Array  # <= 1 where there is one
    z: Array
    scale_z: Array
    margin: Array  # unsigned, of all that this took
    disc: Array  # bool: the ray meets the disc itself
    u: Array
    v: Array


@dataclass(frozen=True, eq=False)
class _Raster:
    """What the two passes share: splats against pixels, whatever the footprint."""

    projected: ProjectedSplats
    camera: Camera
    settings: RenderSettings
    discs: _Discs
    ellipses: _Ellipses | None

    @classmethod
    def of(
        cls,
        projected: ProjectedSplats,
        camera: Camera,
        settings: RenderSettings,
        offset_error: float = OFFSET_ERROR,
    ) -> _Raster:
        discs = replace(_discs(projected, camera), offset_error=offset_error)
        raycast = settings.footprint == "raycast"
        return cls(
            projected, camera, settings, discs, None if raycast else _ellipses(projected, discs, camera, settings)
        )

    def footprint(self, hits: _Hits, s: Array, filtered: bool) -> _Cover:
        """Say where the footprint is, within its clip lines; of an ellipse, `filtered` by EWA or not."""
        if self.ellipses is None:
            return _Cover(hits.r_squared, hits.r, hits.scale_r, hits.margin)
        return _cut(_within(self.ellipses, filtered, self.camera, s), hits.kept, hits.kept_margin)

    def prefilter(self, hits: _Hits, s: Array) -> _Cover:
        """Say where the pre-filter of [BHZK05] is, within the clip lines."""
        return _cut(_prefilter(self.projected, self.camera, self.settings, s), hits.kept, hits.kept_margin)

    def covered(self, s: Array) -> _Fragments:
        """Return the fragments of the visibility pass, which knows no pre-filter."""
        hits = _intersect(self.discs, self.camera, s)
        return self._fragments(hits, self.footprint(hits, s, filtered=False))

    def drawn(self, s: Array) -> _Fragments:
        """Return the fragments of the attribute pass."""
        hits = _intersect(self.discs, self.camera, s)
        footprint = self.footprint(hits, s, filtered=True)
        return self._fragments(hits, footprint, self.prefilter(hits, s) if self.settings.prefilter == "min" else None)

    def _fragments(self, hits: _Hits, footprint: _Cover, prefilter: _Cover | None = None) -> _Fragments:
        """Join what covers a pixel; a fragment whose ray misses the disc takes the centre's depth."""
        r_squared, margin = footprint.r_squared, np.abs(footprint.margin)
        if prefilter is not None:
            margin = np.minimum(margin, np.where(r_squared <= 1, np.inf, np.abs(prefilter.margin)))
            r_squared = np.minimum(r_squared, prefilter.r_squared)
        if self.ellipses is not None:
            margin = np.minimum(margin, np.where(r_squared <= 1, np.abs(hits.margin), np.inf))
        disc, center_z = hits.r_squared <= 1, self.projected.center_eye[:, 2]
        z = np.where(disc, hits.z, center_z)
        scale_z = np.where(disc, hits.scale_z, np.abs(center_z) + TINY)
        return _Fragments(r_squared, z, scale_z, margin, disc, hits.u, hits.v)

    def weight(self, f: _Fragments) -> Array:
        """(P, N) weights where r^2 <= 1, 0 elsewhere."""
        weight, exists = np.zeros(f.r_squared.shape), f.r_squared <= 1
        weight[exists] = _weight(f.r_squared[exists], self.settings)
        if self.ellipses is not None and self.settings.prefilter == "ewa":
            weight *= self.ellipses.factor
        return weight


def visibility(projected: ProjectedSplats, camera: Camera, settings: RenderSettings) -> DepthBuffer:
    """Find the front-most disc at each pixel: depth = min z over r3 <= 1; ties go to the lower index.

    For the other footprints over the ellipse, without its low-pass filter.
    """
    num_pixels = camera.height * camera.width
    depth, margin, id_margin = (np.full(num_pixels, np.inf) for _ in range(3))
    particleid = np.full(num_pixels, NO_SPLAT)
    raster = _Raster.of(projected, camera, settings)
    for pixels, s in _chunks(camera, len(projected.center_eye)):
        f = raster.covered(s[:, None])
        z = np.where(f.r_squared <= 1, f.z, np.inf)
        front = z.argmin(axis=1, keepdims=True)
        nearest = np.take_along_axis(z, front, axis=1)
        depth[pixels] = nearest[:, 0]
        particleid[pixels] = np.where(np.isfinite(nearest), front, NO_SPLAT)[:, 0]
        margin[pixels] = f.margin.min(axis=1)
        with np.errstate(invalid="ignore", over="ignore"):
            gap = (z - nearest) / (UNIT * (f.scale_z + np.take_along_axis(f.scale_z, front, axis=1)))
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
    channels: Array | None = None,
    gloss: Array | None = None,
) -> GBuffer:
    """Accumulate every fragment with r^2 = min(r3^2, r2^2) <= 1 and z <= depth + epsilon.

    `epsilon` is in scene units, along eye z or the ray (`settings.along`); `color` is (N, 3) linear RGB, `channels`
    (N, K) what else is blended, `gloss` (N, 2) specular and shininess, of the material where omitted.
    """
    num, num_pixels = len(color), camera.height * camera.width
    channels = np.zeros((num, 0)) if channels is None else channels
    sums = np.zeros((num_pixels, 8 + channels.shape[1]))  # w, w color, w normal, w channels, w z
    count = np.zeros(num_pixels, np.uint32)
    margin = np.full(num_pixels, np.inf)
    raster = _Raster.of(projected, camera, settings)
    color = color.astype(np.float64)
    if settings.shading == "splat":
        color = shade_points(projected.center_eye, projected.normal_eye, color, camera, settings, gloss)
    for pixels, s in _chunks(camera, num):
        f = raster.drawn(s[:, None])
        exists = f.r_squared <= 1
        tolerance = np.full((len(s), 1), epsilon)
        if settings.along == "ray":
            tolerance /= _ray_length(camera, s)[:, None]
        limit = depth.depth.reshape(-1, 1)[pixels] + tolerance
        accepted = exists & (f.z <= limit)
        weight = np.where(accepted, raster.weight(f), 0.0)
        z = np.where(accepted, f.z, 0.0)
        normal = _fragment_normals(projected, f, settings)
        colors = np.broadcast_to(color, (len(s), num, 3))
        if settings.shading == "fragment":
            position = _points(s, f.z, camera)
            colors = shade_points(position, np.broadcast_to(normal, position.shape), colors, camera, settings, gloss)
        values = [np.ones((len(s), num, 1)), colors, np.broadcast_to(normal, colors.shape)]
        values.append(np.broadcast_to(channels, (len(s), *channels.shape)))
        sums[pixels] = _accumulate(weight, np.concatenate([*values, z[..., None]], axis=2), settings)
        count[pixels] = accepted.sum(axis=1)

        front = depth.particleid.reshape(-1, 1)[pixels]
        front_scale_z = np.take_along_axis(f.scale_z, np.where(front == NO_SPLAT, 0, front).astype(np.int64), axis=1)
        depth_margin = _depth_margin(limit - f.z, f.scale_z, front_scale_z, front == np.arange(num), tolerance)
        depth_margin = np.where(exists, depth_margin, np.inf)
        margin[pixels] = np.minimum(f.margin, depth_margin).min(axis=1)
    columns = (sums[:, 0], sums[:, 1:4], sums[:, 4:7], sums[:, -1], count, margin, sums[:, 7:-1])
    return GBuffer(*(_image(column, camera) for column in columns))


def _fragment_normals(projected: ProjectedSplats, f: _Fragments, settings: RenderSettings) -> Array:
    """(P, N, 3) or (N, 3) unit normals, eye space: of the field where the ray meets the disc, else the centre's."""
    if settings.normals == "constant":
        return projected.normal_eye
    u, v = (np.where(f.disc, x, 0.0)[..., None] for x in (f.u, f.v))
    return _normalize(projected.normal_eye + u * projected.field_u + v * projected.field_v)


def _points(s: Array, z: Array, camera: Camera) -> Array:
    """(P, N, 3) eye-space points of depth z on the (P,) pixels' rays."""
    s = np.broadcast_to(s[:, None], (*z.shape, 3))
    if camera.projection == "perspective":
        return s * z[..., None]
    return np.concatenate([s[..., :2], z[..., None]], axis=-1)


def _accumulate(weight: Array, values: Array, settings: RenderSettings) -> Array:
    """(P, K) sums of weight (P, N) times values (P, N, K) in splat order, in the target's format; z is the last value.

    unorm8 holds a normal as (1 + n) / 2.
    """
    if settings.target not in ("float16", "unorm8"):
        return np.einsum("pn,pnk->pk", weight, values)
    sums = np.zeros((len(weight), values.shape[2]))
    if settings.target == "unorm8":
        values = values.copy()
        values[..., 4:7] = (1 + values[..., 4:7]) / 2
    for w, value in zip(weight.T, values.swapaxes(0, 1), strict=True):
        product = w[:, None] * value
        exact = sums[:, -1] + product[:, -1]
        sums = _rounded(sums + _rounded(product, settings), settings)
        sums[:, -1] = exact
    if settings.target == "unorm8":
        sums[:, 4:7] = 2 * sums[:, 4:7] - sums[:, :1]
    return sums


def _rounded(values: Array, settings: RenderSettings) -> Array:
    """Return numbers of the target's format: IEEE halves, or 0, 1/255 ... 1, clamped to what it holds."""
    if settings.target == "float16":
        return np.clip(values, -65504, 65504).astype(np.float16).astype(np.float64)
    return np.floor(np.clip(values, 0, 1) * 255 + 0.5) / 255


def _cut(cover: _Cover, kept: Array, margin: Array) -> _Cover:
    """Return what clip lines leave."""
    r_squared = np.where(kept, cover.r_squared, np.inf)
    return replace(cover, r_squared=r_squared, margin=np.fmin(cover.margin, margin))


def _prefilter(projected: ProjectedSplats, camera: Camera, settings: RenderSettings, s: Array) -> _Cover:
    """r2^2 = |p - p_c|^2 / prefilter_radius^2, +inf for no pre-filter. `s` as for `_intersect`."""
    radius, error = settings.prefilter_radius, projected.prefilter_error
    p = _raster(s, camera)
    x, y = projected.prefilter_point.T
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        r_squared = ((p[..., 0] - x) ** 2 + (p[..., 1] - y) ** 2) / radius**2
        r = np.sqrt(r_squared)
        scale = 2 * r_squared + 4 * r * error / radius
        margin = np.fmin((1 - r_squared) / (UNIT * scale), projected.facing_margin)
    present = (projected.prefilter_margin >= 0) & ~projected.culled
    margin = np.fmin(margin, projected.prefilter_margin)
    return _Cover(np.where(present, r_squared, np.inf), r, r + 2 * error / radius, margin)


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
