"""Rays, projections and the constants that all of the oracle shares."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from splatcl.oracle.buffers import Array
from splatcl.scene.camera import Camera

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
PAIRS_AT_ONCE = 2**18
"""Splat-pixel pairs held in memory together."""


def pixel_rays(camera: Camera) -> Array:
    """(H W, 3) s = ((x-cx)/fx, (y-cy)/fy, 1) of the pixel centres: a perspective ray is z s, z = depth."""
    x, y = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    s = np.stack([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, np.ones(x.shape)], axis=-1)
    return s.reshape(-1, 3)


def pixel_chunks(camera: Camera, num_splats: int) -> Iterator[tuple[slice, Array]]:
    """Yield pixel ranges and their (P, 3) s, so that P num_splats stays bounded; nothing for no splats."""
    s = pixel_rays(camera)
    step = max(1, PAIRS_AT_ONCE // max(num_splats, 1))
    for start in range(0, len(s) if num_splats else 0, step):
        yield slice(start, start + step), s[start : start + step]


def as_image(column: Array, camera: Camera) -> Array:
    """(H W, ...) -> (H, W, ...)."""
    return column.reshape(camera.height, camera.width, *column.shape[1:])


def ray_length(camera: Camera, s: Array) -> Array:
    """Distance along the ray per unit of eye z."""
    return np.linalg.norm(s, axis=-1) if camera.projection == "perspective" else np.ones(s.shape[:-1])


def to_image_plane(center: Array, camera: Camera) -> Array:
    """Return s_x and s_y, (N, 2), of eye-space points (N, 3)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return center[:, :2] / center[:, 2:] if camera.projection == "perspective" else center[:, :2]


def to_raster(s: Array, camera: Camera) -> Array:
    """Return pixels, (..., 2), of s (..., 2 or 3)."""
    return s[..., :2] * (camera.fx, camera.fy) + (camera.cx, camera.cy)


def normalize(vector: Array) -> Array:
    """Return unit vectors; zero stays zero."""
    length = np.linalg.norm(vector, axis=-1, keepdims=True)
    return vector / np.where(length > 0, length, 1.0)


def facing_cosine(center: Array, t_u: Array, t_v: Array, camera: Camera) -> tuple[Array, Array]:
    """(N,) cos = n.c / |c|, or n_z if orthographic: >= 0 faces away, 0 is edge-on; (N,) its scale."""
    g = np.cross(t_u, t_v)
    toward = normalize(center) if camera.projection == "perspective" else np.array([0.0, 0.0, 1.0])
    scale = 4 * np.linalg.norm(t_u, axis=1) * np.linalg.norm(t_v, axis=1) / np.linalg.norm(g, axis=1)
    return (normalize(g) * toward).sum(axis=1), scale


def range_margin(z: Array, scale: Array, camera: Camera) -> Array:
    """Signed margin of near <= z <= far; NaN where z or its scale is not known."""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        return np.minimum(z - camera.near, camera.far - z) / (UNIT * scale)
