"""Linear normal fields: how a splat's normal turns over its disc, from the normals around it ([BSK04]).

The normal at (u, v) of a disc is normalize(n + u n_du + v n_dv). A normal m seen over the disc therefore asks for
the slope m / (m.n) - n, which is tangential: so are n_du and n_dv, and the field is n at the center. On a
paraboloid these slopes are linear in u and v and the fit is exact; on any smooth surface the error is of the third
order in the disc's radius.
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
from splatcl.scene.splats import Splats
from splatcl.util.progress import stage

NUM_NEIGHBORS = 12
"""Nearest neighbors that a field is estimated from: about two rings."""
MIN_COSINE = 0.5
"""Normals that turn by more than 60 degrees are of another side, or across an edge."""
MAX_HEIGHT = 0.5
"""A point farther off a disc's plane than this share of its radius does not lie over it."""
MIN_NORMALS = 3
"""Fewer normals than this make no field."""
MIN_SPREAD = 1e-3
"""Normals (nearly) along a line through the center make no field: least 4 det / trace^2 of their (u, v) moments."""
CHUNK = 32768
"""Splats of which the neighbors are held at a time."""
BALL_CHUNK = 1024
"""Splats of which the points over them are held at a time."""


def normal_fields(splats: Splats, num_neighbors: int = NUM_NEIGHBORS) -> Splats:
    """Estimate the normal field of each splat from its neighbors' normals.

    A least squares fit over the nearest neighbors on the same side of the surface (normals within 60 degrees; their
    signs are ignored where they mean nothing), in disc coordinates, with weights exp(-2 d^2 / D^2) that fall off with
    the distance d; D is the farthest neighbor's.

    Parameters
    ----------
    splats : Splats
        A field that they have is replaced.
    num_neighbors : int
        Nearest neighbors of a splat that are looked at, at least 3.

    Returns
    -------
    Splats
        The same with `normal_du` and `normal_dv`, tangential, world space. Zero (the normal is constant) where
        fewer than three neighbors are usable or all lie along a line.

    Raises
    ------
    InvalidSplatsError
        `num_neighbors` is less than 3.
    """
    from scipy.spatial import cKDTree

    if num_neighbors < MIN_NORMALS:
        raise InvalidSplatsError(f"num_neighbors is {num_neighbors}; a field needs at least {MIN_NORMALS}")
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
    """Fit the normal field of each splat to the normals of a dense scan that lie over it.

    A point lies over a disc where it projects into it, no farther from its plane than half its radius, and its
    normal is within 60 degrees of the disc's. The weights are the filter's, exp(-2 r^2).

    Parameters
    ----------
    splats : Splats
        A field that they have is replaced. Where their normals' signs mean nothing, those of `normals` are ignored.
    points : (P, 3) float array
        World space, scene units.
    normals : (P, 3) float array
        Of any length but zero.

    Returns
    -------
    Splats
        The same with `normal_du` and `normal_dv`, tangential, world space. Zero where fewer than three points lie
        over a splat, or all along a line through its center.

    Raises
    ------
    InvalidSplatsError
        Wrong shapes, or points with a non-finite coordinate or an unusable normal.
    """
    from scipy.spatial import cKDTree

    reason = invalid_points(points, normals)
    if reason.any():
        first = int(np.flatnonzero(reason)[0])
        raise InvalidSplatsError(
            f"{np.count_nonzero(reason)} of {len(reason)} points cannot be used; the first, point {first}, has "
            f"{REASONS[reason[first]]}"
        )
    place, toward = _local(splats, np.asarray(points)), np.asarray(normals, np.float64).reshape(-1, 3)
    toward = toward / np.linalg.norm(toward, axis=1, keepdims=True)
    fields = np.zeros((2, len(splats), 3))
    with stage("Fitting normal fields", len(splats)) as advance:
        for part, rows, chosen in _balls(splats, cKDTree(place)) if len(place) else ():
            discs = splats.take(part)
            offset = place[chosen] - _local(splats, discs.center)[rows]
            height = np.abs(np.einsum("pi,pi->p", offset, discs.normal[rows]))
            u, v = disc_coordinates(discs, rows, offset)
            squared = u * u + v * v
            weight = np.exp(-2 * squared) * (squared <= 1) * (height <= MAX_HEIGHT * discs.radius[rows])
            fields[:, part] = _fit(discs, rows, (u, v), toward[chosen], weight)
            advance(len(discs))
    return _with_fields(splats, fields)


def disc_coordinates(
    splats: Splats, rows: NDArray[np.integer[Any]], offset: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return (P,) u and v of points at (P, 3) offsets from the centers of the splats `rows`, projected along n."""
    tangent_u, tangent_v = splats.tangent_u.astype(np.float64), splats.tangent_v.astype(np.float64)
    across = np.cross(tangent_u, tangent_v)
    across /= np.einsum("ni,ni->n", across, across)[:, None]
    u = np.einsum("pi,pi->p", offset, np.cross(tangent_v, across)[rows])
    v = np.einsum("pi,pi->p", offset, np.cross(across, tangent_u)[rows])
    return u, v


def fit_slopes(
    rows: NDArray[np.integer[Any]], coordinates: ArrayLike, slopes: NDArray[np.float64], weight: ArrayLike, num: int
) -> NDArray[np.float64]:
    """Fit slopes = u du + v dv for each of `num` rows by weighted least squares.

    Parameters
    ----------
    rows : (P,) int array
        The row that a sample belongs to.
    coordinates : (2, P) float64 array
        Its u and v.
    slopes : (P, S) float64 array
    weight : (P,) float64 array
        0 leaves a sample out.
    num : int
        Number of rows.

    Returns
    -------
    (2, num, S) float64 array
        du and dv; zero for rows with fewer than `MIN_NORMALS` samples, or with all along a line.
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
    """Return (2, N, 3) fields from (P, 3) unit normals at (P,) u and v of the discs `rows`."""
    own = discs.normal[rows]
    cosine = np.einsum("pi,pi->p", normals, own)
    weight = weight * ((cosine if discs.oriented else np.abs(cosine)) >= MIN_COSINE)
    # Divided by a negative cosine, a normal of the wrong sign is turned as well.
    slopes = normals / np.where(weight > 0, cosine, 1.0)[:, None] - own
    return fit_slopes(rows, coordinates, slopes, weight, len(discs))


def _balls(splats: Splats, tree: Any) -> Iterator[tuple[Any, NDArray[np.intp], NDArray[np.intp]]]:
    """Yield parts of the splats with pairs: the row of a splat in its part, and a point within its radius."""
    center, radius = _local(splats, splats.center), splats.radius
    for start in range(0, len(splats), BALL_CHUNK):
        part: Any = slice(start, min(start + BALL_CHUNK, len(splats)))
        # A disc's points may be off its plane.
        found = tree.query_ball_point(center[part], radius[part] * np.hypot(1.0, MAX_HEIGHT), workers=-1)
        counts = np.fromiter(map(len, found), np.intp, len(found))
        chosen = np.fromiter(chain.from_iterable(found), np.intp, int(counts.sum()))
        yield part, np.repeat(np.arange(len(counts)), counts), chosen


def _local(splats: Splats, points: NDArray[Any]) -> NDArray[np.float64]:
    """Return points relative to the first splat's center: a survey's large coordinates cost no precision."""
    origin = splats.center[0] if len(splats) else np.zeros(3)
    return points.astype(np.float64) - origin.astype(np.float64)


def _with_fields(splats: Splats, fields: NDArray[np.float64]) -> Splats:
    normal_du, normal_dv = fields.astype(splats.tangent_u.dtype)
    return replace(splats, normal_du=normal_du, normal_dv=normal_dv, on_invalid="error")
