"""Point sets and discs with known normals and spacing."""

from __future__ import annotations

import numpy as np
from helpers.scenes import frames

from splatcl import Splats


def fibonacci_sphere(num):
    i = np.arange(num) + 0.5
    z, angle = 1 - 2 * i / num, np.pi * (1 + 5**0.5) * i
    r = np.sqrt(1 - z * z)
    return np.stack([r * np.cos(angle), r * np.sin(angle), z], axis=1)


def grid(nx, ny, dx=1.0, dy=1.0, jitter=0.0):
    x, y = np.meshgrid(np.arange(nx), np.arange(ny))
    points = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3).astype(float)
    points[:, :2] += np.random.default_rng(3).uniform(-jitter, jitter, (len(points), 2))
    return points * (dx, dy, 1)


ANGLES = 2 * np.pi * np.arange(12) / 12


def discs(points, normals, radius, **further):
    u, v = frames(normals)
    return Splats(points, u * radius, v * radius, **further)


def plane(nx=12, ny=12):
    return discs(grid(nx, ny), np.tile((0.0, 0.0, 1.0), (nx * ny, 1)), 0.75)


def field_normals(splats, u, v):
    normals = splats.normal + u * splats.normal_du + v * splats.normal_dv
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


def rim_errors(splats, scale):
    """Return the largest error of the field's and of the constant normals on the rims of discs that touch a sphere."""
    worst = np.zeros(2)
    for angle in ANGLES:
        u, v = np.cos(angle), np.sin(angle)
        flat = (u * splats.tangent_u + v * splats.tangent_v) / scale
        true = flat + splats.normal * np.sqrt(1 - np.sum(flat**2, axis=1, keepdims=True))
        for i, normals in enumerate((field_normals(splats, u, v), splats.normal)):
            worst[i] = max(worst[i], np.linalg.norm(normals - true, axis=1).max())
    return worst
