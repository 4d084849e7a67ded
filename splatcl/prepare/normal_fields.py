"""Linear normal fields: the change of a splat's normal over its disc, fitted to the normals around it ([BSK04]).

The normal at (u, v) of a disc is normalize(n + u n_du + v n_dv). A normal m over the disc gives the slope
m / (m.n) - n of the field there. Slopes are tangential, therefore n_du and n_dv are too, and the field is n at the
center. On a paraboloid the slopes are linear in u and v, so the fit is exact. On any smooth surface the error is of
third order in the disc's radius.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from splatcl.errors import InvalidSplatsError
from splatcl.prepare.points import REASONS, invalid_points
from splatcl.prepare.voronoi import MIN_FLATNESS
from splatcl.scene.splats import Splats, describe_reasons
from splatcl.util.progress import stage

NUM_NEIGHBORS = 12
"""Default number of nearest neighbors for a field: about two rings."""
MIN_COSINE = 0.5
"""Least cosine of a normal and the disc's normal, 60 degrees: beyond, it is of another side or across an edge."""
MAX_HEIGHT = 0.5
"""Largest distance of a point over a disc from the disc's plane, in units of its radius."""
MIN_NORMALS = 3
"""Least number of normals for a field."""
MIN_SPREAD = 1e-3
"""Least 4 det / trace^2 of the (u, v) moments: below it, the points lie (nearly) on a line through the center."""
CHUNK = 32768
"""Splats per chunk of the neighbor search."""
BALL_CHUNK = 1024
"""Splats per chunk of the search for points over discs."""


def normal_fields(splats: Splats, num_neighbors: int = NUM_NEIGHBORS) -> Splats:
    """Estimate the normal field of each splat from its neighbors' normals.

    The field is a least squares fit in disc coordinates. It takes the nearest neighbors whose normals are within
    60 degrees; signs of normals are ignored unless ``splats.oriented``. A neighbor at distance d has the weight
    exp(-2 d^2 / D^2), where D is the farthest neighbor's distance.

    Parameters
    ----------
    splats : Splats
        An existing normal field is replaced.
    num_neighbors : int
        Number of nearest neighbors for a field, at least 3.

    Returns
    -------
    Splats
        The same splats with `normal_du` and `normal_dv`, tangential, world space. Both are zero, a constant normal,
        if fewer than three neighbors are usable or all of them lie on a line.

    Raises
    ------
    InvalidSplatsError
        `num_neighbors` is less than 3.
    """
    from scipy.spatial import cKDTree

    if num_neighbors < MIN_NORMALS:
        raise InvalidSplatsError(f"num_neighbors is {num_neighbors}; it must be at least {MIN_NORMALS}")
    center, normal, num = _local(splats, splats.center), splats.normal, len(splats)
    count = min(num_neighbors, num - 1)
    if count < MIN_NORMALS:
        return _with_fields(splats, np.zeros((2, num, 3)))
    tree: Any = cKDTree(center)
    fields = np.empty((2, num, 3))
    with stage("Estimating normal fields", num) as advance:
        for start in range(0, num, CHUNK):
            part: Any = slice(start, min(start + CHUNK, num))
            distance, ids = tree.query(center[part], count + 1, workers=-1)
            rows = np.repeat(np.arange(len(ids)), count)
            farthest = np.maximum(distance[:, -1:], np.finfo(float).tiny)
            weight = np.exp(-2 * (distance[:, 1:] / farthest) ** 2).ravel()
            chosen = ids[:, 1:].ravel()
            offset = center[chosen] - center[part][rows]
            height = np.einsum("pi,pi->p", offset, normal[part][rows])
            squared = np.einsum("pi,pi->p", offset, offset)
            weight *= squared - height * height > MIN_FLATNESS**2 * squared
            discs = splats.take(part)
            uv = disc_coordinates(discs, rows, offset)
            fields[:, part] = _fit(discs, rows, uv, normal[chosen], weight)
            advance(len(ids))
    return _with_fields(splats, fields)


def fit_normal_fields(splats: Splats, points: ArrayLike, normals: ArrayLike) -> Splats:
    """Fit the normal field of each splat to the normals of the points of a dense scan over it.

    A point is over a disc if it projects into the disc, at most half the disc's radius from its plane. The two normals
    must be within 60 degrees. A point has the reconstruction filter's weight exp(-2 r^2).

    Parameters
    ----------
    splats : Splats
        An existing normal field is replaced. Unless ``splats.oriented``, signs of normals are ignored.
    points : (P, 3) float array
        World space, scene units.
    normals : (P, 3) float array
        World space, any length but zero.

    Returns
    -------
    Splats
        The same splats with `normal_du` and `normal_dv`, tangential, world space. Both are zero if fewer than three
        points are over the splat, or if they lie on a line through its center.

    Raises
    ------
    InvalidSplatsError
        An array has a wrong shape, or a point has a non-finite coordinate or an unusable normal.
    """
    from scipy.spatial import cKDTree

    reason = invalid_points(points, normals)
    if reason.any():
        raise InvalidSplatsError(f"{describe_reasons(reason, REASONS, 'point')} cannot be used; remove them")
    local, unit = _local(splats, np.asarray(points)), np.asarray(normals, np.float64).reshape(-1, 3)
    unit = unit / np.linalg.norm(unit, axis=1, keepdims=True)
    fields = np.zeros((2, len(splats), 3))
    with stage("Fitting normal fields", len(splats)) as advance:
        for part, rows, chosen in _balls(splats, cKDTree(local)) if len(local) else ():
            discs = splats.take(part)
            offset = local[chosen] - _local(splats, discs.center)[rows]
            height = np.abs(np.einsum("pi,pi->p", offset, discs.normal[rows]))
            u, v = disc_coordinates(discs, rows, offset)
            squared = u * u + v * v
            weight = np.exp(-2 * squared) * (squared <= 1) * (height <= MAX_HEIGHT * discs.radius[rows])
            fields[:, part] = _fit(discs, rows, (u, v), unit[chosen], weight)
            advance(len(discs))
    return _with_fields(splats, fields)


def disc_coordinates(
    splats: Splats, rows: NDArray[np.integer[Any]], offset: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Project points along the normals into the discs `rows`; return (P,) u and v.

    `offset` is (P, 3): the points relative to the discs' centers, world space.
    """
    tangent_u, tangent_v = splats.tangent_u.astype(np.float64), splats.tangent_v.astype(np.float64)
    normal = np.cross(tangent_u, tangent_v)
    normal /= np.einsum("ni,ni->n", normal, normal)[:, None]
    u = np.einsum("pi,pi->p", offset, np.cross(tangent_v, normal)[rows])
    v = np.einsum("pi,pi->p", offset, np.cross(normal, tangent_u)[rows])
    return u, v


def fit_slopes(
    rows: NDArray[np.integer[Any]], coordinates: ArrayLike, slopes: NDArray[np.float64], weight: ArrayLike, num: int
) -> NDArray[np.float64]:
    """Fit slopes = u du + v dv to the samples of each row by weighted least squares.

    Parameters
    ----------
    rows : (P,) int array
        The row of each sample.
    coordinates : (2, P) float64 array
        u and v of each sample.
    slopes : (P, S) float64 array
        Values of each sample.
    weight : (P,) float64 array
        Weight of each sample; 0 excludes it.
    num : int
        Number of rows.

    Returns
    -------
    (2, num, S) float64 array
        du and dv; zero for a row with fewer than `MIN_NORMALS` samples, or with all samples on a line.
    """
    u, v = np.asarray(coordinates)
    weight = np.asarray(weight)

    def total(values: Any) -> NDArray[np.float64]:
        return np.bincount(rows, values, num).astype(np.float64, copy=False)

    uu, uv, vv = total(weight * u * u), total(weight * u * v), total(weight * v * v)
    determinant = uu * vv - uv * uv
    usable = (total(weight > 0) >= MIN_NORMALS) & (4 * determinant > MIN_SPREAD * (uu + vv) ** 2)
    scale = usable / np.where(usable, determinant, 1.0)
    fields = np.empty((2, num, slopes.shape[1]))
    for k, slope in enumerate(slopes.T):
        us, vs = total(weight * u * slope), total(weight * v * slope)
        fields[0, :, k] = (vv * us - uv * vs) * scale
        fields[1, :, k] = (uu * vs - uv * us) * scale
    return fields


def _fit(
    discs: Splats,
    rows: NDArray[np.integer[Any]],
    coordinates: tuple[NDArray[np.float64], NDArray[np.float64]],
    normals: NDArray[np.float64],
    weight: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return (2, N, 3) fields from (P, 3) unit normals at (P,) u and v of the discs `rows`, world space."""
    center_normal = discs.normal[rows]
    cosine = np.einsum("pi,pi->p", normals, center_normal)
    weight = weight * ((cosine if discs.oriented else np.abs(cosine)) >= MIN_COSINE)
    # A negative cosine also turns a normal of the wrong sign.
    slopes = normals / np.where(weight > 0, cosine, 1.0)[:, None] - center_normal
    return fit_slopes(rows, coordinates, slopes, weight, len(discs))


def _balls(splats: Splats, tree: Any) -> Iterator[tuple[Any, NDArray[np.intp], NDArray[np.intp]]]:
    """Yield a slice of the splats, and its pairs of a splat (row in the slice) and a point within its radius."""
    center, radius = _local(splats, splats.center), splats.radius
    for start in range(0, len(splats), BALL_CHUNK):
        part: Any = slice(start, min(start + BALL_CHUNK, len(splats)))
        # Points over a disc may lie off its plane.
        found = tree.query_ball_point(center[part], radius[part] * np.hypot(1.0, MAX_HEIGHT), workers=-1)
        counts = np.fromiter(map(len, found), np.intp, len(found))
        chosen = np.fromiter(chain.from_iterable(found), np.intp, int(counts.sum()))
        yield part, np.repeat(np.arange(len(counts)), counts), chosen


def _local(splats: Splats, points: NDArray[Any]) -> NDArray[np.float64]:
    """Return points relative to the first splat's center: a survey's large coordinates would cost precision."""
    origin = splats.center[0] if len(splats) else np.zeros(3)
    return points.astype(np.float64) - origin.astype(np.float64)


def _with_fields(splats: Splats, fields: NDArray[np.float64]) -> Splats:
    normal_du, normal_dv = fields.astype(splats.tangent_u.dtype)
    return replace(splats, normal_du=normal_du, normal_dv=normal_dv, on_invalid="error")
