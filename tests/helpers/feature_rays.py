"""Discs with clip lines against points and rays, in float64, by a linear solve each: for the tests of features."""

import numpy as np
from helpers.oracle_cases import rays


def disc_coordinates(splats, ids, points):
    """Return the (N, 2) u and v of (N, 3) points, projected onto the planes of the discs `ids`."""
    system = np.stack([splats.tangent_u[ids], splats.tangent_v[ids], splats.normal[ids]], axis=2)
    return np.linalg.solve(system, (points - splats.center[ids])[..., None])[:, :2, 0]


def inside(splats, ids, u, v, slack=0.0):
    """Return whether disc coordinates lie in the discs `ids` and on the kept side of their lines."""
    a, b, c = np.moveaxis(splats.clip[ids], -1, 0)
    lines = a * u[..., None] + b * v[..., None] + c
    return (u**2 + v**2 <= 1) & (lines >= -slack).all(axis=-1)


def kept(splats, ids, points, slack=0.0):
    return inside(splats, ids, *disc_coordinates(splats, ids, points).T, slack)


def kept_places(splats, num, seed=0):
    """Return (M, 3) random points of the kept part of each disc, `num` per whole disc, and the (M,) splat of each."""
    rng = np.random.default_rng(seed)
    radius, angle = np.sqrt(rng.random((2, len(splats), num)))
    radius[:, ::4] = 1.0  # a quarter of them on the rim
    u, v = radius * np.cos(2 * np.pi * angle**2), radius * np.sin(2 * np.pi * angle**2)
    ids = np.repeat(np.arange(len(splats)), num)
    left = inside(splats, ids, u.ravel(), v.ravel())
    ids, u, v = ids[left], u.ravel()[left, None], v.ravel()[left, None]
    return splats.center[ids] + u * splats.tangent_u[ids] + v * splats.tangent_v[ids], ids


def directions(camera):
    """Return the (H, W, 3) rays of a perspective camera's pixel centers in eye space, with z = 1."""
    s = rays(camera)
    return np.concatenate([s, np.ones((*s.shape[:2], 1))], axis=-1)


def slabs(camera, low, high):
    """Return the (H, W, 3) z where each pixel's ray enters and leaves each axis' slab of a box in world space."""
    d = directions(camera) @ camera.eye_from_world[:3, :3]
    with np.errstate(divide="ignore"):
        a, b = (low - camera.position) / d, (high - camera.position) / d
    return np.minimum(a, b), np.maximum(a, b)


def cast(splats, camera):
    """Return the (H, W) least z of front faces at pixel centers, and the (N, H, W) splats at this z, -1 elsewhere."""
    rotation, shift = camera.eye_from_world[:3, :3], camera.eye_from_world[:3, 3]
    c, t_u, t_v = splats.center @ rotation.T + shift, splats.tangent_u @ rotation.T, splats.tangent_v @ rotation.T
    d = directions(camera)
    z = np.full((len(splats), *d.shape[:2]), np.inf)
    for i in np.flatnonzero((np.cross(t_u, t_v) * c).sum(axis=1) < 0):
        # c + u t_u + v t_v = z d
        system = np.stack([*np.broadcast_arrays(t_u[i], t_v[i], -d)], axis=-1)
        u, v, depth = np.moveaxis(
            np.linalg.solve(system, np.broadcast_to(-c[i, :, None], (*d.shape, 1)))[..., 0], -1, 0
        )
        z[i] = np.where((depth > 0) & inside(splats, i, u, v), depth, np.inf)
    least = z.min(axis=0)
    at_front = np.isfinite(z) & (z <= least * (1 + 1e-9))
    return least, np.where(at_front, np.arange(len(splats))[:, None, None], -1)
