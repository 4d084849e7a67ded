"""The attribute pass: every splat against every pixel."""

from __future__ import annotations

import numpy as np

from splatcl.oracle.buffers import NO_SPLAT, Array, DepthBuffer, GBuffer, ProjectedSplats
from splatcl.oracle.geometry.fragments import Footprints, Fragments
from splatcl.oracle.geometry.rays import UNIT, as_image, normalize, pixel_chunks, ray_length
from splatcl.oracle.shade import shade_points
from splatcl.scene.camera import Camera
from splatcl.scene.settings import RenderSettings


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
    footprints = Footprints.of(projected, camera, settings)
    color = color.astype(np.float64)
    if settings.shading == "splat":
        color = shade_points(projected.center_eye, projected.normal_eye, color, camera, settings, gloss)
    for pixels, s in pixel_chunks(camera, num):
        f = footprints.attribute_fragments(s[:, None])
        exists = f.r_squared <= 1
        tolerance = np.full((len(s), 1), epsilon)
        if settings.along == "ray":
            tolerance /= ray_length(camera, s)[:, None]
        limit = depth.depth.reshape(-1, 1)[pixels] + tolerance
        accepted = exists & (f.z <= limit)
        weight = np.where(accepted, footprints.weight(f), 0.0)
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
    return GBuffer(*(as_image(column, camera) for column in columns))


def _fragment_normals(projected: ProjectedSplats, f: Fragments, settings: RenderSettings) -> Array:
    """(P, N, 3) or (N, 3) unit normals, eye space: of the field where the ray meets the disc, else the centre's."""
    if settings.normals == "constant":
        return projected.normal_eye
    u, v = (np.where(f.disc, x, 0.0)[..., None] for x in (f.u, f.v))
    return normalize(projected.normal_eye + u * projected.field_u + v * projected.field_v)


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


def _depth_margin(slack: Array, scale_z: Array, front_scale_z: Array, is_front: Array, tolerance: Array) -> Array:
    """Margin of z <= depth + epsilon, +inf for the front-most splat itself and where no disc was hit."""
    with np.errstate(invalid="ignore", over="ignore"):
        margin = np.abs(slack) / (UNIT * (scale_z + front_scale_z + tolerance))
    return np.where(is_front | (slack == np.inf), np.inf, margin)
