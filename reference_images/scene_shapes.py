"""Parts of the scenes: discs, positions, colors."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from splatcl import Splats


def splats(center: ArrayLike, tangent_u: ArrayLike, tangent_v: ArrayLike, color: ArrayLike) -> Splats:
    """Return splats rounded to float32; one color may stand for all."""
    color = np.broadcast_to(color, np.shape(center))
    return Splats(*(np.asarray(a, np.float32) for a in (center, tangent_u, tangent_v)), np.asarray(color, np.float32))


def discs(center: ArrayLike, normal: ArrayLike, radius: ArrayLike, color: ArrayLike) -> Splats:
    """Return circular splats. Normals may have any length; one normal, radius or color may stand for all."""
    normal = unit(np.broadcast_to(np.asarray(normal, float), np.shape(center)))
    u = unit(np.cross(normal, np.where(np.abs(normal[:, :1]) < 0.9, [[1.0, 0, 0]], [[0, 1.0, 0]])))
    radius = np.reshape(radius, (-1, 1))
    return splats(center, u * radius, np.cross(normal, u) * radius, color)


def fibonacci_sphere(num: int) -> NDArray[np.float64]:
    """Return (num, 3) points spread evenly over the unit sphere."""
    i = np.arange(num) + 0.5
    y, angle = 1 - 2 * i / num, np.pi * (1 + 5**0.5) * i
    ring = np.sqrt(1 - y**2)
    return np.stack([ring * np.cos(angle), y, ring * np.sin(angle)], axis=1)


def grid(x: ArrayLike, y: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the flat coordinates of every pair, x fastest."""
    columns, rows = np.meshgrid(x, y)
    return columns.ravel(), rows.ravel()


def unit(vector: ArrayLike) -> NDArray[np.float64]:
    """Return unit vectors."""
    return vector / np.linalg.norm(vector, axis=-1, keepdims=True)


def hue(turn: ArrayLike) -> NDArray[np.float64]:
    """Return (N, 3) bright colors around the color wheel: 0 red, 1/3 green, 2/3 blue."""
    return np.clip(np.abs((np.reshape(turn, (-1, 1)) * 6 + [0, 4, 2]) % 6 - 3) - 1, 0, 1) * 0.9 + 0.02
