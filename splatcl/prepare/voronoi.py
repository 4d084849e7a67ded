"""Voronoi cells in tangent planes, and the ellipses that cover them, for many points at once.

The points are along the last axis of arrays in this module: NumPy is several times faster so.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

NUM_DIRECTIONS = 16
"""Number of directions for the search of a cell's boundary; the ellipse covers the cell for any number."""
MAX_ASPECT = 4.0
"""Largest ratio of an estimated disc's principal radii."""
NUM_ITERATIONS = 6
"""Number of steps toward the least ellipse; the ellipse covers the cell after any number."""
MIN_DISTANCE = 1e-6
"""Least distance of a neighbor, in units of `reach`: a nearer one coincides with the point."""
MAX_DISTANCE = 100.0
"""Largest distance of a neighbor, in units of `reach`: a farther one has no edge of the cell."""
SURROUNDED = -2.0
"""Cotangent of 153 degrees, the widest angle between two neighbors with surface between them."""
PARALLEL = 1e-5
"""Least sine of the angle between two edges that meet: below it, rounding decides where they meet."""
MIN_FLATNESS = 0.7
"""Least in-plane share of a neighbor's distance: below it, the neighbor is of another sheet of the surface."""


def tangent_frame(normals: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return (N, 3) unit vectors u and v with u x v = n for (N, 3) unit normals n (Duff et al. 2017)."""
    x, y, z = normals.T
    sign = np.copysign(1.0, z)
    a = -1.0 / (sign + z)
    b = x * y * a
    u = np.stack([1.0 + sign * x * x * a, sign * b, -sign * x], axis=1)
    v = np.stack([b, sign + y * y * a, -y], axis=1)
    return u, v


def principal(xx: Any, xy: Any, yy: Any) -> tuple[Any, Any, Any]:
    """Return the mean, the spread and the turn of symmetric 2x2 matrices.

    The eigenvalues are mean +- spread. The eigenvector of the greater one is at the angle `turn` from x, radians.
    """
    return 0.5 * (xx + yy), np.hypot(0.5 * (xx - yy), xy), 0.5 * np.arctan2(2 * xy, xx - yy)


def covering_ellipse(
    offsets: NDArray[np.float64], frame: NDArray[np.float64], reach: NDArray[np.floating[Any]]
) -> NDArray[np.float64]:
    """Return ellipses about points that cover the points' Voronoi cells in the tangent planes.

    Parameters
    ----------
    offsets : (3, K, N) float64 array
        Neighbors relative to their points, the nearest first, scene units, none zero.
    frame : (2, 3, N) float64 array
        Orthonormal tangents.
    reach : (N,) float array
        Largest distance of a cell vertex on the surface, scene units; a farther one is beyond the boundary.

    Returns
    -------
    (2, 2, N) float64 array
        Two principal half axes (the longer first) in the frame's coordinates, scene units, with the orientation of
        the frame.
    """
    duals, nearest = _duals(offsets, frame, reach)
    corners = _cell_corners(*duals)
    # A lone point, or one of points on a line, has no corner within reach: it gets half its nearest distance.
    lonely = ~corners.any(axis=(0, 1))
    corners[:, :, lonely] = 1.0
    axes = _least_ellipse(*corners) * reach
    axes[:, :, lonely] = np.minimum(0.5 * nearest, reach)[lonely] * np.eye(2)[..., None]
    return axes


def _duals(
    offsets: NDArray[np.float64], frame: NDArray[np.float64], reach: NDArray[np.floating[Any]]
) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
    """Return (2, K, N) duals w of the cells' edges, and (N,) distances of the nearest neighbors.

    The cell is the set of x with w.x <= 1 for every neighbor, x in units of `reach`. With q the neighbor turned into
    the plane at its true distance, w = 2 q / |q|^2. A neighbor off the plane has w = 0: no edge.
    """
    distance = np.sqrt(_dot(offsets, offsets))
    flat = np.stack([_dot(offsets, axis) for axis in frame])
    length = np.sqrt(_dot(flat, flat))
    relative = distance / np.maximum(reach, 1e-300)
    in_plane = (length > MIN_FLATNESS * distance) & (relative > MIN_DISTANCE) & (relative < MAX_DISTANCE)
    scale = np.where(in_plane, 2 * reach / np.where(in_plane, length * distance, 1.0), 0.0)
    return (flat * scale).astype(np.float32), distance[0]


def _dot(a: Any, b: Any) -> Any:
    """Return the dot products of vectors along the first axis."""
    total = a[0] * b[0]
    for x, y in zip(a[1:], b[1:], strict=True):
        total += x * y
    return total


def _cell_corners(x: NDArray[np.float32], y: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return (2, 2 D, N) points whose convex hull covers each cell within the unit disc, from (K, N) duals.

    The cell is the polar dual of the hull of the duals. Two consecutive hull vertices a, b give the corner c with
    a.c = b.c = 1. If the D directions skip a hull vertex, c lies farther out, so the hull still covers the cell.
    A corner beyond reach is moved to distance 1 if neighbors surround the point. At the surface's boundary it is
    replaced by the feet a / |a|^2 and b / |b|^2 of its two edges. Unused rows are zero.
    """
    support = _support(x, y)
    ax, ay = np.take_along_axis(x, support, axis=0), np.take_along_axis(y, support, axis=0)
    bx, by = np.roll(ax, -1, axis=0), np.roll(ay, -1, axis=0)
    length = np.sqrt(ax * ax + ay * ay)
    cross = ax * by - ay * bx
    rise_x, rise_y = by - ay, ax - bx
    rise = np.sqrt(rise_x * rise_x + rise_y * rise_y)
    corner_exists = support != np.roll(support, -1, axis=0)
    surrounded = ax * bx + ay * by > SURROUNDED * cross
    meet = cross > PARALLEL * length * np.roll(length, -1, axis=0)
    closed = corner_exists & meet & ((rise <= cross) | surrounded)
    opened = corner_exists & ~closed
    to_corner = 1 / np.where(closed, np.maximum(cross, rise), 1.0)
    to_foot = (length >= 1.0) / np.maximum(length, 1.0) ** 2
    foot_x, foot_y = ax * to_foot, ay * to_foot
    # An open corner has the feet of a and of b.
    first = [np.where(closed, r * to_corner, foot * opened) for r, foot in ((rise_x, foot_x), (rise_y, foot_y))]
    second = [np.roll(foot, -1, axis=0) * opened for foot in (foot_x, foot_y)]
    return np.concatenate([first, second], axis=1)


def _support(x: NDArray[np.float32], y: NDArray[np.float32]) -> NDArray[np.int32]:
    """Return (D, N) indices of the farthest of (K, N) points in each of D directions.

    Lengths carry the point's index in their lowest bits, so that one maximum finds both; this is ten times as fast as
    argmax. The minimum is the maximum of the opposite direction. Lengths within 4e-6 may count as equal.
    """
    bits = np.int32((1 << (len(x) - 1).bit_length()) - 1)
    number = np.arange(len(x), dtype=np.int32)[::-1, None]  # reversed, so that the nearest neighbor wins a tie
    half = NUM_DIRECTIONS // 2
    support = np.empty((NUM_DIRECTIONS, x.shape[1]), np.int32)
    for direction in range(half):
        angle = 2 * np.pi * direction / NUM_DIRECTIONS
        along = np.float32(np.cos(angle)) * x + np.float32(np.sin(angle)) * y
        packed = along.view(np.int32)
        packed &= ~bits
        packed |= number
        support[direction] = along.max(axis=0).view(np.int32)
        support[direction + half] = along.min(axis=0).view(np.int32)
    return len(x) - 1 - (support & bits)


def _least_ellipse(x: NDArray[np.float32], y: NDArray[np.float32]) -> NDArray[np.float64]:
    """Return (2, 2, N) half axes of (nearly) the least ellipses about the origin that contain (C, N) points."""
    xx, xy, yy = x * x, x * y, y * y
    weight = (xx + yy > 0).astype(np.float32)
    weight /= weight.sum(axis=0)
    ridge = 1e-3 * (xx + yy).max(axis=0)
    for _ in range(NUM_ITERATIONS):
        moments = [(weight * m).sum(axis=0) for m in (xx, xy, yy)]
        weight *= _power(moments, ridge, xx, xy, yy)
        weight /= weight.sum(axis=0)
    mean, spread, turn = principal(*((weight * m).sum(axis=0, dtype=np.float64) for m in (xx, xy, yy)))
    long, short = np.sqrt(mean + spread), np.sqrt(np.maximum(mean - spread, 0.0))
    short = np.maximum(short, long / MAX_ASPECT)
    cos, sin = np.cos(turn), np.sin(turn)
    u, v = (cos * x + sin * y) / long, (cos * y - sin * x) / short
    grow = np.sqrt((u * u + v * v).max(axis=0))
    return np.array([[cos * long, sin * long], [-sin * short, cos * short]]) * grow


def _power(moments: list[Any], ridge: Any, xx: Any, xy: Any, yy: Any) -> NDArray[np.float32]:
    """Return (C, N) x^T M^-1 x of the points; M has the (N,) moments and a ridge on the diagonal."""
    p, q, r = moments[0] + ridge, moments[1], moments[2] + ridge
    scale = 1.0 / (p * r - q * q)
    return (r * scale) * xx - (2 * q * scale) * xy + (p * scale) * yy
