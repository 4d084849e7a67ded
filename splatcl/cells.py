"""Voronoi cells in tangent planes and the ellipses that cover them, for many points at once."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

NUM_DIRECTIONS = 16
"""Directions in which a cell's boundary is sought; the result covers the cell for any number of them."""
MAX_ASPECT = 4.0
"""Largest ratio of an estimated disc's principal radii."""
NUM_ITERATIONS = 6
"""Steps toward the least ellipse; any number covers the cell, more are slightly tighter."""
MIN_DISTANCE = 1e-6
"""Neighbours nearer than this share of `reach` are at the point's own place."""
MAX_DISTANCE = 100.0
"""Neighbours farther than this many times `reach` have no part in the cell."""
SURROUNDED = -2.0
"""Cotangent of the widest angle between two neighbours that the surface is sure to fill: 153 degrees."""
MIN_FLATNESS = 0.7
"""A neighbour is of another sheet of the surface where less than this share of its distance is in-plane."""


def tangent_frame(normals: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return two (N, 3) unit vectors with u x v = n for (N, 3) unit normals (Duff et al. 2017)."""
    x, y, z = normals.T
    sign = np.copysign(1.0, z)
    a = -1.0 / (sign + z)
    b = x * y * a
    u = np.stack([1.0 + sign * x * x * a, sign * b, -sign * x], axis=1)
    v = np.stack([b, sign + y * y * a, -y], axis=1)
    return u, v


def covering_ellipse(
    offsets: NDArray[np.float64],
    frame: tuple[NDArray[np.float64], NDArray[np.float64]],
    reach: NDArray[np.floating[Any]],
) -> NDArray[np.float64]:
    """Return ellipses about the points that cover their Voronoi cells in their tangent planes.

    Parameters
    ----------
    offsets : (N, K, 3) float64 array
        Neighbours relative to their points, scene units, none zero.
    frame : pair of (N, 3) float64 arrays
        Orthonormal tangents.
    reach : (N,) float array
        Cell vertices farther than this are taken to be outside the surface, scene units.

    Returns
    -------
    (N, 2, 2) float64 array
        Two principal half axes (rows, the longer first) in the frame's coordinates, scene units. They turn
        the same way as the frame.
    """
    duals, nearest = _duals(offsets, frame, reach)
    corners = _cell_corners(duals)
    # No corner within reach (a lone point, or points along a line): half the way to the nearest neighbour.
    lonely: NDArray[np.bool_] = ~corners.any(axis=(1, 2))  # type: ignore[assignment]
    axes = _least_ellipse(np.where(lonely[:, None, None], 1.0, corners))
    axes *= reach[:, None, None]
    radius = np.minimum(0.5 * nearest, reach)
    axes[lonely] = radius[lonely, None, None] * np.eye(2)
    return axes


def _duals(
    offsets: NDArray[np.float64],
    frame: tuple[NDArray[np.float64], NDArray[np.float64]],
    reach: NDArray[np.floating[Any]],
) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
    """Return (N, K, 2) duals w of the cells' edges and the (N,) distances of the nearest neighbours.

    The cell is where w.x <= 1 for every neighbour, x in units of `reach`: with q the neighbour's place in
    the plane at its true distance, w = 2 q / |q|^2. Neighbours off the plane have w = 0, no edge.
    """
    distance = np.sqrt(np.einsum("nki,nki->nk", offsets, offsets))
    flat = np.stack([np.einsum("nki,ni->nk", offsets, axis) for axis in frame], axis=2)
    length = np.sqrt(np.einsum("nki,nki->nk", flat, flat))
    share = distance / np.maximum(reach, 1e-300)[:, None]
    in_plane = (length > MIN_FLATNESS * distance) & (share > MIN_DISTANCE) & (share < MAX_DISTANCE)
    scale = np.where(in_plane, 2 * reach[:, None] / np.where(in_plane, length * distance, 1.0), 0.0)
    return (flat * scale[..., None]).astype(np.float32), distance[:, 0]


def _cell_corners(duals: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return (N, 2 D, 2) points whose convex hull covers each cell within the unit disc.

    The cell is the polar dual of the hull of `duals`. Two hull vertices a, b that follow each other meet
    in the corner x with a.x = b.x = 1; where the directions skip a hull vertex, x is only farther out.
    A corner beyond reach is drawn in to it where the neighbours surround the point; at the surface's
    boundary the feet a / |a|^2 of its two edges stand in for it. Unused rows are zero.
    """
    angle = np.arange(NUM_DIRECTIONS, dtype=np.float32) * np.float32(2 * np.pi / NUM_DIRECTIONS)
    along = np.stack([np.cos(angle), np.sin(angle)])
    support = (duals @ along).argmax(axis=1)
    a = np.take_along_axis(duals, support[..., None], axis=1)
    b = np.roll(a, -1, axis=1)
    cross = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    rise = np.stack([b[..., 1] - a[..., 1], a[..., 0] - b[..., 0]], axis=2)
    corner_exists = support != np.roll(support, -1, axis=1)
    far = np.sqrt(np.einsum("nki,nki->nk", rise, rise))
    surrounded = np.einsum("nki,nki->nk", a, b) > SURROUNDED * cross
    closed = corner_exists & (cross > 0) & ((far <= cross) | surrounded)
    corner = rise / np.where(closed, np.maximum(cross, far), 1.0)[..., None]
    length = np.einsum("nki,nki->nk", a, a)
    foot_exists = length >= 1.0
    foot = a / np.where(foot_exists, length, 1.0)[..., None] * foot_exists[..., None]
    foot *= (corner_exists | np.roll(corner_exists, 1, axis=1))[..., None]
    first = np.where(closed[..., None], corner, foot * corner_exists[..., None])
    # The foot of b belongs to an open corner as well; with a closed one it is not needed.
    second = np.where((corner_exists & ~closed)[..., None], np.roll(foot, -1, axis=1), 0.0)
    return np.concatenate([first, second], axis=1)


def _least_ellipse(corners: NDArray[np.float32]) -> NDArray[np.float64]:
    """Return (N, 2, 2) half axes of nearly the least origin-centred ellipses that hold (N, C, 2) points."""
    x, y = corners[..., 0], corners[..., 1]
    xx, xy, yy = x * x, x * y, y * y
    weight = (xx + yy > 0).astype(np.float32)
    weight /= weight.sum(axis=1, keepdims=True)
    ridge = 1e-3 * (xx + yy).max(axis=1)
    for _ in range(NUM_ITERATIONS):
        moments = [np.einsum("nk,nk->n", weight, m) for m in (xx, xy, yy)]
        weight *= _power(moments, ridge, xx, xy, yy) * 0.5
        weight /= weight.sum(axis=1, keepdims=True)
    p, q, r = (np.einsum("nk,nk->n", weight, m, dtype=np.float64) for m in (xx, xy, yy))
    turn = 0.5 * np.arctan2(2 * q, p - r)
    half, spread = 0.5 * (p + r), np.hypot(0.5 * (p - r), q)
    long, short = np.sqrt(half + spread), np.sqrt(np.maximum(half - spread, 0.0))
    short = np.maximum(short, long / MAX_ASPECT)
    cos, sin = np.cos(turn)[:, None], np.sin(turn)[:, None]
    u, v = (cos * x + sin * y) / long[:, None], (cos * y - sin * x) / short[:, None]
    grow = np.sqrt((u * u + v * v).max(axis=1))
    axes = np.stack([np.hstack([cos, sin]) * long[:, None], np.hstack([-sin, cos]) * short[:, None]], axis=1)
    return axes * grow[:, None, None]


def _power(moments: list[Any], ridge: Any, xx: Any, xy: Any, yy: Any) -> NDArray[np.float32]:
    """Return (N, C) x^T M^-1 x of the points, M the (N,) moments with a ridge on the diagonal."""
    p, q, r = moments[0] + ridge, moments[1], moments[2] + ridge
    scale = 1.0 / (p * r - q * q)
    return (r * scale)[:, None] * xx - (2 * q * scale)[:, None] * xy + (p * scale)[:, None] * yy
