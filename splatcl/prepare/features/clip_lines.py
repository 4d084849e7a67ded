"""Clip lines: the lines in which planes cut discs, and the choice of two lines for each disc ([ZRB04] section 5).

A line (a, b, c) keeps the half plane a u + b v + c >= 0, in disc coordinates. It is normalized if |(a, b)| = 1.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from splatcl.errors import InvalidSplatsError
from splatcl.scene.splats import Splats

Array = NDArray[Any]
MIN_SINE = 1e-6
"""Least sine of the angle of two planes that meet in a line: below it, discs stored in float32 are parallel."""
LEAST_CUT = 1e-6
"""Least depth of a cut, disc coordinates: a line that cuts less deep cuts nothing."""
MAX_LINES = 2
"""Largest number of lines of a splat."""


def clip_lines(splats: Splats, pairs: ArrayLike, convex: ArrayLike | None = None) -> Splats:
    """Cut pairs of splats off along the line in which their planes meet.

    Both splats of a pair get the same line in space, their common edge, each in its own disc coordinates. At a convex
    edge each splat keeps its part behind the other's plane; at a concave edge, its part in front of it.

    Parameters
    ----------
    splats : Splats
        Existing clip lines compete with the new ones.
    pairs : (P, 2) int array
        Indices of splats on different sides of an edge.
    convex : bool or (P,) bool array, optional
        Whether the edge of each pair is convex (less than 180 degrees of solid). By default an edge is convex if the
        two normals point away from each other: (n_j - n_i).(c_j - c_i) > 0.

    Returns
    -------
    Splats
        The same splats with `clip`: float64 rows (a, b, c) with |(a, b)| = 1, so that c is the center's distance from
        the line in disc coordinates. A splat keeps the two lines that cut deepest. The notes count dropped lines,
        pairs of parallel planes, and splats that the lines cut off entirely.

    Raises
    ------
    InvalidSplatsError
        `pairs` has a wrong shape, an index is out of range, or a pair names one splat twice.
    """
    i, j = _pairs(pairs, len(splats)).T
    center, normal = splats.center.astype(np.float64), splats.normal
    apart = center[j] - center[i]
    if convex is None:
        keeps_behind = ((normal[j] - normal[i]) * apart).sum(axis=1) > 0
    else:
        keeps_behind = np.broadcast_to(np.asarray(convex, bool), i.shape)
    side = np.where(keeps_behind, -1.0, 1.0)[:, None]
    owner, other = np.concatenate([i, j]), np.concatenate([j, i])
    u, v = splats.tangent_u.astype(np.float64), splats.tangent_v.astype(np.float64)
    lines = plane_lines(center[owner], u[owner], v[owner], center[other], np.tile(side, (2, 1)) * normal[other])
    parallel = int(np.count_nonzero(~lines[: len(i)].any(axis=1)))
    if splats.clip is not None:
        owner = np.concatenate([np.repeat(np.arange(len(splats)), MAX_LINES), owner])
        lines = np.concatenate([normalize(splats.clip.reshape(-1, 3)), lines])
    clip, lost = keep_deepest(owner, lines, len(splats))
    notes = [f"cut {np.count_nonzero(clip.any(axis=(1, 2)))} of {len(splats)} splats off along {len(i)} edges"]
    notes += lost_note(int(np.count_nonzero(lost)))
    gone = int(np.count_nonzero(cut_depth(np.zeros((len(splats), 3)), clip) > 0))
    notes += [f"cut {gone} splats off entirely"] if gone else []
    notes += [f"{parallel} pairs of splats are parallel and have no clip line"] if parallel else []
    return replace(splats, clip=clip, notes=(*splats.notes, *notes), on_invalid="error")


def plane_lines(center: Array, tangent_u: Array, tangent_v: Array, point: Array, normal: Array) -> Array:
    """Return the lines that keep the part of each disc on the positive side of a plane.

    Parameters
    ----------
    center, tangent_u, tangent_v : (N, 3) float64 arrays
        Discs, world space, with orthogonal tangents.
    point, normal : (N, 3) float64 arrays
        A point of each plane, world space, and the unit normal toward the kept side.

    Returns
    -------
    (N, 3) float64 array
        Normalized lines; zeros for a disc parallel to its plane.
    """
    a, b = ((normal * tangent).sum(axis=1) for tangent in (tangent_u, tangent_v))
    c = (normal * (center - point)).sum(axis=1)
    sine = np.hypot(a / np.linalg.norm(tangent_u, axis=1), b / np.linalg.norm(tangent_v, axis=1))
    return normalize(np.where((sine > MIN_SINE)[:, None], np.stack([a, b, c], axis=1), 0.0))


def normalize(lines: Array) -> Array:
    """Scale (N, 3) lines to |(a, b)| = 1, float64; zeros stay zeros."""
    lines = lines.astype(np.float64)
    length = np.hypot(lines[:, 0], lines[:, 1])[:, None]
    return np.where(length > 0, lines / np.where(length > 0, length, 1.0), 0.0)


def cut_depth(lines: Array, clip: Array) -> Array:
    """Return the least value a u + b v + c of each line over the clipped disc.

    Parameters
    ----------
    lines : (N, 3) float64 array
        Normalized lines.
    clip : (N, 2, 3) float64 array
        Normalized clip lines of the discs; zeros cut nothing.

    Returns
    -------
    (N,) float64 array
        Disc coordinates: -d for a line that cuts d deep, >= 0 for one that cuts nothing, +inf for an empty disc.
    """
    # A linear function is least on the rim, at an intersection of a clip line with the rim, or at that of two lines.
    corners = [-lines[:, None, :2], *(_rim_points(clip[:, k]) for k in range(MAX_LINES)), _intersection(clip)[:, None]]
    points = np.concatenate(corners, axis=1)
    with np.errstate(invalid="ignore"):
        kept = (points**2).sum(axis=2) <= 1 + 1e-12
        for k in range(MAX_LINES):
            kept &= evaluate(clip[:, None, k], points) >= -1e-12
        return np.where(kept, evaluate(lines[:, None], points), np.inf).min(axis=1, initial=np.inf)


def evaluate(lines: Array, points: Array) -> Array:
    """Return a u + b v + c of (..., 3) lines at (..., 2) points, disc coordinates."""
    value: Array = (lines[..., :2] * points).sum(axis=-1) + lines[..., 2]
    return value


def _rim_points(line: Array) -> Array:
    """Return the (N, 2, 2) intersections of (N, 3) lines with the unit circle; NaN without an intersection."""
    a, b, c = line.T
    with np.errstate(invalid="ignore"):
        half = np.sqrt(np.where(line.any(axis=1), 1 - c * c, np.nan))
    return np.stack([np.stack([s * -b * half - a * c, s * a * half - b * c], axis=1) for s in (-1, 1)], axis=1)


def _intersection(clip: Array) -> Array:
    """Return the (N, 2) intersections of the two lines of each disc; NaN or infinite for parallel lines."""
    x, y, w = np.cross(clip[:, 0], clip[:, 1]).T
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.stack([x / w, y / w], axis=1)


def keep_deepest(
    owner: Array, lines: Array, num: int, needed: Callable[[Array], Array] | None = None
) -> tuple[Array, Array]:
    """Choose two lines for each splat: the one that cuts deepest, then the one that cuts deepest into the rest.

    Parameters
    ----------
    owner : (L,) int array
        The splat of each line.
    lines : (L, 3) float64 array
        Normalized lines.
    num : int
        Number of splats.
    needed : callable, optional
        Maps the (L, 2, 3) lines chosen so far for each line's splat to (L,) bool: whether the line counts. By default
        all lines count.

    Returns
    -------
    clip : (num, 2, 3) float64 array
        Normalized lines; zeros cut nothing.
    lost : (L,) bool array
        Lines that were not chosen although they would cut more off.
    """
    clip = np.zeros((num, MAX_LINES, 3))

    def depths() -> Array:
        depth = cut_depth(lines, clip[owner])
        return depth if needed is None else np.where(needed(clip[owner]), depth, np.inf)

    for slot in range(MAX_LINES):
        depth = depths()
        order = np.lexsort((depth, owner))
        first = order[np.diff(owner[order], prepend=-1) > 0]
        best = first[depth[first] < -LEAST_CUT]
        clip[owner[best], slot] = lines[best]
    return clip, depths() < -LEAST_CUT


def lost_note(num: int) -> list[str]:
    """Return a note on the number of lost lines, or no note."""
    return [f"dropped {num} clip lines of splats with two deeper ones"] if num else []


def _pairs(pairs: ArrayLike, num: int) -> NDArray[np.intp]:
    """Check the pairs of splats, indices below `num`; return them as a (P, 2) array."""
    array = np.asarray(pairs)
    if not array.size:
        array = np.empty((0, 2), np.intp)
    if array.ndim != 2 or array.shape[1] != 2 or array.dtype.kind not in "iu":
        raise InvalidSplatsError(f"pairs are {array.dtype} of shape {array.shape}; they must be integers, (P, 2)")
    bad = ((array < 0) | (array >= num)).any(axis=1) | (array[:, 0] == array[:, 1])
    if bad.any():
        k = int(np.flatnonzero(bad)[0])
        raise InvalidSplatsError(
            f"pair {k} has splats {array[k, 0]} and {array[k, 1]}; they must be two of {num} (0 to {num - 1})"
        )
    return array.astype(np.intp)
