"""Pixel rays, projections and the constants of the margins.

s = ((x - cx) / fx, (y - cy) / fy, 1) are the image-plane coordinates of a raster point (x, y). Under perspective the
ray is z s. Orthographic, it starts at (s_x, s_y, 0) and runs along z. The parameter is eye z in both cases.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from splatcl.oracle.buffers import Array
from splatcl.scene.camera import Camera

UNIT = 2.0**-24
"""Half a float32 ulp of 1, the unit of every scale."""
EDGE_ON = 2.0**-16
"""Largest |cos| between a splat's normal and the line to its center at which the splat counts as edge-on."""
OFFSET_ERROR = 2.0
"""Error of a pixel's offset from a projected center, 2^-24 pixels."""
TINY = np.finfo(np.float64).tiny
"""Least scale, so that an exact tie has margin 0 even at z = 0."""
CLEAR = 1e-4
"""A disc is clear of the eye plane if its least z is above this fraction of its center's z."""
PAIRS_AT_ONCE = 2**18
"""Splat-pixel pairs in memory at a time."""


def pixel_rays(camera: Camera) -> Array:
    """Return s (H W, 3) of all pixel centers, in row-major order."""
    x, y = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    s = np.stack([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, np.ones(x.shape)], axis=-1)
    return s.reshape(-1, 3)


def pixel_chunks(camera: Camera, num_splats: int) -> Iterator[tuple[slice, Array]]:
    """Yield ranges of pixels with their s (P, 3), at most `PAIRS_AT_ONCE` pairs or one pixel; none for no splats."""
    s = pixel_rays(camera)
    step = max(1, PAIRS_AT_ONCE // max(num_splats, 1))
    for start in range(0, len(s) if num_splats else 0, step):
        yield slice(start, start + step), s[start : start + step]


def as_image(column: Array, camera: Camera) -> Array:
    """Reshape (H W, ...) to (H, W, ...)."""
    return column.reshape(camera.height, camera.width, *column.shape[1:])


def ray_length(camera: Camera, s: Array) -> Array:
    """Return the distance (...) along the rays s (..., 3) per unit of eye z."""
    return np.linalg.norm(s, axis=-1) if camera.projection == "perspective" else np.ones(s.shape[:-1])


def on_rays(s: Array, z: Array, camera: Camera) -> Array:
    """Return the eye-space points (..., 3) of depth z (...) on the rays s (..., 3)."""
    if camera.projection == "perspective":
        return s * z[..., None]
    return np.concatenate([np.broadcast_to(s[..., :2], (*z.shape, 2)), z[..., None]], axis=-1)


def to_image_plane(center: Array, camera: Camera) -> Array:
    """Project eye-space points (N, 3) to s_x and s_y, (N, 2)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return center[:, :2] / center[:, 2:] if camera.projection == "perspective" else center[:, :2]


def to_raster(s: Array, camera: Camera) -> Array:
    """Map s (..., 2 or 3) to raster points (..., 2), pixels."""
    return s[..., :2] * (camera.fx, camera.fy) + (camera.cx, camera.cy)


def normalize(vector: Array) -> Array:
    """Scale vectors (..., 3) to length 1; zero stays zero."""
    length = np.linalg.norm(vector, axis=-1, keepdims=True)
    return vector / np.where(length > 0, length, 1.0)


def facing_cosine(center: Array, t_u: Array, t_v: Array, camera: Camera) -> tuple[Array, Array]:
    """Return the cosine (N,) between each splat's normal and the line to its center, and its scale (N,).

    The cosine is n.c / |c|, or n_z for an orthographic camera. It is >= 0 for a splat that faces away, 0 for one seen
    edge-on. `center`, `t_u` and `t_v` are (N, 3) in eye space.
    """
    g = np.cross(t_u, t_v)
    toward = normalize(center) if camera.projection == "perspective" else np.array([0.0, 0.0, 1.0])
    scale = 4 * np.linalg.norm(t_u, axis=1) * np.linalg.norm(t_v, axis=1) / np.linalg.norm(g, axis=1)
    return (normalize(g) * toward).sum(axis=1), scale


def range_margin(z: Array, scale: Array, camera: Camera) -> Array:
    """Return the signed margin (...) of near <= z <= far; NaN where z or its scale is NaN."""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        return np.minimum(z - camera.near, camera.far - z) / (UNIT * scale)
