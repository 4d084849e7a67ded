"""Conversion of polygons and strips to triangles."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def triangulate(polygons: Any, notes: list[str]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Convert polygons to fans of triangles.

    Parameters
    ----------
    polygons : (F, K) int array or sequence of F int sequences
        Vertex indices.
    notes : list of str
        Receives a sentence about polygons of fewer than three corners, which are dropped.

    Returns
    -------
    triangles : (T, 3) int64 array
        Vertex indices.
    source : (T,) int64 array
        The polygon of each triangle.
    """
    if isinstance(polygons, np.ndarray) and polygons.ndim == 2 and polygons.shape[1] == 3:
        return polygons.astype(np.int64), np.arange(len(polygons))
    size = np.array([len(polygon) for polygon in polygons], np.int64)
    if (size < 3).any():
        notes.append(f"dropped {np.count_nonzero(size < 3)} faces of fewer than 3 corners")
    flat = np.concatenate([np.asarray(p, np.int64) for p in polygons]) if len(size) else np.empty(0, np.int64)
    num = np.maximum(size - 2, 0)
    source = np.repeat(np.arange(len(size)), num)
    first = (np.cumsum(size) - size)[source]
    step = np.arange(num.sum()) - (np.cumsum(num) - num)[source]
    return np.stack([flat[first], flat[first + step + 1], flat[first + step + 2]], axis=1), source


def triangulate_strips(strips: list[Any]) -> NDArray[np.int64]:
    """Convert strips to (T, 3) triangles; a negative index begins a new strip."""
    parts = [np.empty((0, 3), np.int64)]
    for strip in strips:
        index = np.asarray(strip, np.int64)
        for run in np.split(index, np.flatnonzero(index < 0)):
            run = run[run >= 0]
            if len(run) < 3:
                continue
            triangles = np.stack([run[:-2], run[1:-1], run[2:]], axis=1)
            triangles[1::2] = triangles[1::2, [1, 0, 2]]
            parts.append(triangles)
    triangles = np.concatenate(parts)
    a, b, c = triangles.T
    # Repeated corners join strips; they are no triangles.
    return triangles[(a != b) & (b != c) & (c != a)]
