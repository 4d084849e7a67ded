"""Attribute pass: blend the fragments of every splat at every pixel ([BHZK05])."""

from __future__ import annotations

import numpy as np

from splatcl.oracle.buffers import NO_SPLAT, Array, DepthBuffer, GBuffer, ProjectedSplats, Surface
from splatcl.oracle.geometry.fragments import Footprints, Fragments
from splatcl.oracle.geometry.rays import UNIT, as_image, normalize, on_rays, pixel_chunks, ray_length
from splatcl.oracle.shade import phong_terms, shade_points
from splatcl.scene.camera import Camera
from splatcl.scene.settings import RenderSettings
from splatcl.scene.splats import Splats


def attributes(
    projected: ProjectedSplats,
    depth: DepthBuffer,
    splats: Splats,
    camera: Camera,
    settings: RenderSettings,
    epsilon: float,
) -> GBuffer:
    """Accumulate w, w color, w n, w z and w a over the fragments with r^2 <= 1 and z <= depth(p) + epsilon.

    The second test is z < depth(p) + epsilon under epsilon_test="strict".

    r^2 = min(r3^2, r2^2) with the pre-filter "min" ([BHZK05] section 5). Under shading="fragment" ([BSK04]) and "splat"
    ([BK03]) the color is lit before it is blended.

    Parameters
    ----------
    projected, depth
        Outputs of `project` and `visibility` for `splats`.
    splats
        The N splats, for their linear RGB and their named attributes.
    epsilon
        Depth tolerance, scene units along eye z, or along the viewing ray under along="ray" ([ZRB04]).
    """
    num, num_pixels = len(splats), camera.height * camera.width
    names = list(splats.attributes)
    named = np.stack([splats.attributes[name] for name in names], axis=1) if names else np.zeros((num, 0))
    sums = np.zeros((num_pixels, 8 + len(names)))  # w, w color, w normal, w attributes, w z
    count = np.zeros(num_pixels, np.uint32)
    margin = np.full(num_pixels, np.inf)
    footprints = Footprints.of(projected, camera, settings)
    color = splats.color.astype(np.float64)
    terms = phong_terms(splats.attributes, settings.material)
    if settings.shading == "splat":
        surface = Surface(projected.center_eye, projected.normal_eye, color, np.ones(num), *terms)
        color = shade_points(surface, camera, settings)
    for pixels, s in pixel_chunks(camera, num):
        depths = depth.depth.reshape(-1, 1)[pixels]
        f = footprints.attribute_fragments(s[:, None], depths)
        exists = f.r_squared <= 1
        tolerance = np.full((len(s), 1), epsilon)
        if settings.along == "ray":
            tolerance /= ray_length(camera, s)[:, None]
        limit = depths + tolerance
        strict = settings.epsilon_test == "strict"
        accepted = exists & (f.z < limit if strict else f.z <= limit)
        weight = np.where(accepted, footprints.weight(f), 0.0)
        z = np.where(accepted, f.z, 0.0)
        normal = np.broadcast_to(_fragment_normals(projected, f, settings), (len(s), num, 3))
        colors = np.broadcast_to(color, normal.shape)
        if settings.shading == "fragment":
            surface = Surface(on_rays(s[:, None], f.z, camera), normal, colors, weight, *terms)
            colors = shade_points(surface, camera, settings)
        blended = [np.ones((len(s), num, 1)), colors, normal, np.broadcast_to(named, (len(s), *named.shape))]
        sums[pixels] = _accumulate(weight, np.concatenate([*blended, z[..., None]], axis=2), settings)
        count[pixels] = accepted.sum(axis=1)

        front = depth.particleid.reshape(-1, 1)[pixels]
        front_scale_z = np.take_along_axis(f.scale_z, np.where(front == NO_SPLAT, 0, front).astype(np.int64), axis=1)
        is_front = (front == np.arange(num)) | f.at_front
        depth_margin = _depth_margin(limit - f.z, f.scale_z, front_scale_z, is_front, tolerance)
        if strict:
            depth_margin = np.where(is_front, _own_margin(depths, tolerance), depth_margin)
        depth_margin = np.where(exists, depth_margin, np.inf)
        margin[pixels] = np.minimum(f.margin, depth_margin).min(axis=1)
    return GBuffer(
        weight_sum=as_image(sums[:, 0], camera),
        color_sum=as_image(sums[:, 1:4], camera),
        normal_sum=as_image(sums[:, 4:7], camera),
        depth_sum=as_image(sums[:, -1], camera),
        count=as_image(count, camera),
        margin=as_image(margin, camera),
        attribute_sum={name: as_image(sums[:, 7 + k], camera) for k, name in enumerate(names)},
    )


def _fragment_normals(projected: ProjectedSplats, f: Fragments, settings: RenderSettings) -> Array:
    """Return unit normals, (P, N, 3) or (N, 3), eye space; normalize(n + u n_du + v n_dv) for a field ([BSK04]).

    A fragment whose ray misses the disc takes the normal at the splat's center.
    """
    if settings.normals == "constant":
        return projected.normal_eye
    u, v = (np.where(f.on_disc, x, 0.0)[..., None] for x in (f.u, f.v))
    return normalize(projected.normal_eye + u * projected.field_u + v * projected.field_v)


def _accumulate(weight: Array, values: Array, settings: RenderSettings) -> Array:
    """Sum weight (P, N) times values (P, N, K) to (P, K), in splat order and in the target's format.

    The last value is z, whose sum is never rounded. The format "unorm8" stores a normal n as (1 + n) / 2.
    """
    if settings.target not in ("float16", "float16_clamped", "unorm8"):
        return np.einsum("pn,pnk->pk", weight, values)
    sums = np.zeros((len(weight), values.shape[2]))
    if settings.target == "unorm8":
        values = values.copy()
        values[..., 4:7] = (1 + values[..., 4:7]) / 2
    for w, value in zip(weight.T, values.swapaxes(0, 1), strict=True):
        product = w[:, None] * value
        exact = sums[:, -1] + product[:, -1]
        with np.errstate(invalid="ignore"):  # infinities of both signs sum to NaN
            sums = _rounded(sums + _rounded(product, settings), settings)
        sums[:, -1] = exact
    if settings.target == "unorm8":
        sums[:, 4:7] = 2 * sums[:, 4:7] - sums[:, :1]
    return sums


def _rounded(values: Array, settings: RenderSettings) -> Array:
    """Round to IEEE halves, which overflow to infinity ("float16") or are clamped, or to 0, 1/255 ... 1 ("unorm8")."""
    if settings.target != "unorm8":
        most = np.inf if settings.target == "float16" else 65504
        with np.errstate(over="ignore"):
            return np.clip(values, -most, most).astype(np.float16).astype(np.float64)
    return np.floor(np.clip(values, 0, 1) * 255 + 0.5) / 255


def _depth_margin(slack: Array, scale_z: Array, front_scale_z: Array, is_front: Array, tolerance: Array) -> Array:
    """Return the margin (P, N) of z <= depth(p) + epsilon; +inf for the front-most splat and where depth(p) is +inf."""
    with np.errstate(invalid="ignore", over="ignore"):
        margin = np.abs(slack) / (UNIT * (scale_z + front_scale_z + tolerance))
    return np.where(is_front | (slack == np.inf), np.inf, margin)


def _own_margin(depth: Array, tolerance: Array) -> Array:
    """Return the margin (P, 1) of depth(p) < depth(p) + epsilon; only the rounding of the sum can flip it.

    It is +inf for an epsilon of 0, where the test fails however it is computed.
    """
    with np.errstate(invalid="ignore"):
        return np.where(tolerance > 0, tolerance / (UNIT * (np.abs(depth) + tolerance)), np.inf)
