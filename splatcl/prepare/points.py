"""Estimate splats for points: normals from the nearest neighbors, tangent axes from the Voronoi cell.

A disc must cover its point's Voronoi cell in the tangent plane, or the surface has holes. Each disc is
therefore (nearly) the least ellipse about its point that contains the cell.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from splatcl.errors import InvalidSplatsError
from splatcl.prepare.voronoi import covering_ellipse, tangent_frame
from splatcl.scene.splats import MAX_MAGNITUDE, OnInvalid, Splats

NUM_NEIGHBORS = 20
SPACING_NEIGHBOR = 6
"""A point's spacing is its distance to this neighbor: about the ring of direct neighbors on a surface."""
REACH = 1.75
"""A Voronoi vertex farther than this many spacings lies beyond the surface's boundary, not in a gap of it."""
MARGIN = 1.05
"""Discs are this much larger than their cells: they are tilted against each other on a curved surface."""
LONE_RADIUS = 1.0
"""Radius of a point that has no other point to measure a spacing from, scene units."""
CHUNK = 2048
"""Points per chunk: the temporaries, a few MB for each thread, are to stay in its cache."""
MIN_GAP = 1e-3
"""Where the two least eigenvalues of a matrix differ by less than about this share of its size, LAPACK is asked."""

REASONS = (
    "",
    "a non-finite coordinate",
    "a coordinate beyond 1e15",
    "a zero or non-finite normal",
    "a non-finite color",
    "a radius that is not positive",
)


def splats_from_points(
    points: ArrayLike,
    normals: ArrayLike | None = None,
    color: ArrayLike | None = None,
    radius: ArrayLike | None = None,
    *,
    num_neighbors: int = NUM_NEIGHBORS,
    on_invalid: OnInvalid = "error",
    notes: Iterable[str] = (),
) -> Splats:
    """Make splats that cover the surface which the points sample.

    Parameters
    ----------
    points : (N, 3) float array
        World space, scene units; float32 and float64 are kept.
    normals : (N, 3) float array, optional
        Any length but zero. Estimated where omitted (their signs then mean nothing: ``oriented=False``).
    color : (N, 3) float array, optional
        Linear RGB.
    radius : (N,) or scalar float array, optional
        Makes circular discs of these radii, scene units. Estimated where omitted.
    num_neighbors : int
        Nearest neighbors that an estimate is made from, at least 3.
    on_invalid : {"error", "drop"}
        What to do with unusable points.
    notes : iterable of str
        Sentences to put before the ones about the estimates.

    Returns
    -------
    Splats
        One for each usable point, in order.

    Raises
    ------
    InvalidSplatsError
        Wrong shapes, no points, or unusable points under ``on_invalid="error"``.
    """
    arrays = _arrays(points, normals, color, radius)
    reason = _reasons(arrays)
    all_notes = list(notes)
    num_dropped = int(np.count_nonzero(reason))
    if num_dropped:
        text = _describe(reason)
        if on_invalid == "error":
            raise InvalidSplatsError(f"{text}; drop them with on_invalid='drop'")
        arrays = {name: array[reason == 0] for name, array in arrays.items()}
        all_notes.append(f"dropped {text}")
    if not len(arrays["points"]):
        raise InvalidSplatsError("no usable point is left" if num_dropped else "there are no points")
    tangents, note = _tangents(arrays, max(3, num_neighbors))
    dtype = arrays["points"].dtype
    return Splats(
        arrays["points"],
        tangents[0].astype(dtype),
        tangents[1].astype(dtype),
        arrays.get("color"),  # type: ignore[arg-type]
        oriented=normals is not None,
        num_dropped=num_dropped,
        notes=(*all_notes, *note),
        on_invalid=on_invalid,
    )


def invalid_points(
    points: ArrayLike,
    normals: ArrayLike | None = None,
    color: ArrayLike | None = None,
    radius: ArrayLike | None = None,
) -> NDArray[np.uint8]:
    """Return (N,) uint8: 0 for a usable point, else the index in `REASONS` of what is wrong with it."""
    return _reasons(_arrays(points, normals, color, radius))


def estimate_spacing(points: ArrayLike, max_samples: int = 50_000) -> float:
    """Return the median distance of a point to its nearest other place, scene units; 0 for one place.

    Of more than `max_samples` points, evenly chosen ones are measured, against all.
    """
    from scipy.spatial import KDTree

    array = np.asarray(points, np.float64)
    if len(array) < 2:
        return 0.0
    sample = array[:: -(-len(array) // max_samples)]
    distance = KDTree(array).query(sample, min(8, len(array)), workers=-1)[0]
    nearest = np.where(distance > 0, distance, np.inf).min(axis=1)
    return float(np.median(nearest[np.isfinite(nearest)])) if np.isfinite(nearest).any() else 0.0


def _tangents(arrays: dict[str, NDArray[Any]], num_neighbors: int) -> tuple[NDArray[np.float64], tuple[str, ...]]:
    """Return (2, N, 3) tangent axes and a sentence on what of them was estimated."""
    points, normals, radius = arrays["points"], arrays.get("normals"), arrays.get("radius")
    if normals is not None:
        normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    if normals is not None and radius is not None:
        return np.stack(tangent_frame(normals)) * radius[:, None], ()
    # Near the origin, so that a survey's large coordinates cost no precision.
    local = points.astype(np.float64) - points.mean(axis=0, dtype=np.float64)
    tangents, used = _estimate(local, normals, num_neighbors)
    what = [] if normals is not None else [f"normals (PCA, {used} neighbors)"]
    if radius is not None:
        with np.errstate(invalid="ignore"):
            tangents *= (radius / np.linalg.norm(tangents, axis=2))[..., None]
    else:
        median = np.median(np.linalg.norm(tangents, axis=2).max(axis=0))
        what.append(f"radii (median {median:.3g})")
    return tangents, (f"estimated {' and '.join(what)} for {len(points)} points",)


def _estimate(
    points: NDArray[np.float64], normals: NDArray[np.float64] | None, num_neighbors: int
) -> tuple[NDArray[np.float64], int]:
    """Return (2, N, 3) tangent axes and how many neighbors they were estimated from."""
    places, (tree, spacing, nearest) = points, _tree(points)
    order = tree.indices  # neighboring points follow each other, which makes searches twice as fast
    if len(points) > 1 and not nearest.min() > 0:
        places = np.unique(points, axis=0)  # points at one place are no neighbors of each other
        tree, spacing, _ = _tree(places)
    num_neighbors = min(num_neighbors, len(places) - 1)
    tangents = np.empty((2, len(points), 3))

    planes = np.ascontiguousarray(places.T)

    def estimate(start: int) -> None:
        chunk = order[start : start + CHUNK]
        here = points[chunk]
        ids = np.ascontiguousarray(tree.query(here, num_neighbors + 1)[1].T)
        offsets = planes[:, ids[1:]] - here.T[:, None]
        frame = np.stack(tangent_frame(_pca_normals(offsets) if normals is None else normals[chunk]))
        reach = REACH * np.median(spacing[ids], axis=0)
        ellipse = covering_ellipse(offsets, np.ascontiguousarray(frame.transpose(0, 2, 1)), reach) * MARGIN
        tangents[:, chunk] = np.einsum("afn,fni->ani", ellipse, frame)

    if num_neighbors:
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            for _ in pool.map(estimate, range(0, len(points), CHUNK)):
                pass
    else:
        up = np.tile((0.0, 0.0, 1.0), (len(points), 1))
        tangents[:] = np.stack(tangent_frame(up if normals is None else normals)) * LONE_RADIUS
    return tangents, num_neighbors


def _pca_normals(offsets: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (N, 3) unit normals of the planes through (3, K, N) neighbors, given relative to their points.

    The sign is fixed: the largest component is positive.
    """
    total = offsets.shape[1] + 1
    mean = offsets.sum(axis=1) / total
    pairs = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
    spread = np.stack([(offsets[i] * offsets[j]).sum(axis=0) / total - mean[i] * mean[j] for i, j in pairs])
    normals = least_eigenvectors(spread)
    rows = np.arange(len(normals))
    return normals * np.sign(normals[rows, np.abs(normals).argmax(axis=1)])[:, None]


def least_eigenvectors(matrices: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (N, 3) unit eigenvectors of the least eigenvalues of symmetric matrices.

    Parameters
    ----------
    matrices : (6, N) float64 array
        Their elements xx, xy, xz, yy, yz, zz.
    """
    xx, xy, xz, yy, yz, zz = matrices
    # The least root of the characteristic polynomial, for the matrix less its mean, of size 1 (Smith 1961).
    mean = (xx + yy + zz) / 3
    squares = (xx - mean) ** 2 + (yy - mean) ** 2 + (zz - mean) ** 2 + 2 * (xy * xy + xz * xz + yz * yz)
    size = np.sqrt(squares / 6)
    scale = 1 / np.where(size > 0, size, 1.0)
    a, b, c = (xx - mean) * scale, (yy - mean) * scale, (zz - mean) * scale
    d, e, f = xy * scale, xz * scale, yz * scale
    determinant = a * (b * c - f * f) - d * (d * c - e * f) + e * (d * f - b * e)
    least = 2 * np.cos(np.arccos(np.clip(determinant / 2, -1.0, 1.0)) / 3 + 2 * np.pi / 3)
    # The other two eigenvectors span the rows of what is left without it: the longest cross product is across both.
    rows = np.array([[a - least, d, e], [d, b - least, f], [e, f, c - least]])
    across = np.array([_cross(rows[i], rows[j]) for i, j in ((0, 1), (1, 2), (2, 0))])
    lengths = np.sqrt((across**2).sum(axis=1))
    longest = lengths.argmax(axis=0)
    n = np.arange(len(mean))
    length = lengths[longest, n]
    unsure = ~(length > MIN_GAP)
    vectors: NDArray[np.float64] = across[longest, :, n] / np.where(unsure, 1.0, length)[:, None]
    if unsure.any():
        full = matrices[:, unsure][[0, 1, 2, 1, 3, 4, 2, 4, 5]].T.reshape(-1, 3, 3)
        vectors[unsure] = np.linalg.eigh(full)[1][:, :, 0]
    return vectors


def _cross(a: Any, b: Any) -> list[Any]:
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def _tree(points: NDArray[np.float64]) -> tuple[Any, NDArray[np.float64], NDArray[np.float64]]:
    """Return a search tree and (N,) distances to the `SPACING_NEIGHBOR`th and to the nearest neighbor."""
    from scipy.spatial import KDTree

    tree: Any = KDTree(points)
    distance = np.zeros((len(points), 2))
    if len(points) > 1:
        k = min(SPACING_NEIGHBOR + 1, len(points))
        distance[tree.indices] = tree.query(points[tree.indices], [2, k], workers=-1)[0]
    return tree, distance[:, 1], distance[:, 0]


def _arrays(points: ArrayLike, normals: Any, color: Any, radius: Any) -> dict[str, NDArray[Any]]:
    """Return the given arrays as floats, checked for shape; `points` keeps float32 or float64."""
    given = {"points": points, "normals": normals, "color": color, "radius": radius}
    arrays: dict[str, NDArray[Any]] = {}
    for name, value in given.items():
        if value is None:
            continue
        try:
            array = np.asarray(value)
            kept = name != "normals" and array.dtype in (np.float32, np.float64)
            array = array if kept else array.astype(np.float64)
        except (TypeError, ValueError) as error:
            raise InvalidSplatsError(f"{name} is not an array of numbers ({error})") from None
        num = len(arrays["points"]) if arrays else len(array) if array.ndim else 0
        if name == "radius" and array.ndim == 0:
            array = np.full(num, array)
        shape = (num,) if name == "radius" else (num, 3)
        if array.shape != shape:
            raise InvalidSplatsError(f"{name} has shape {array.shape}; it must be {shape}")
        arrays[name] = array
    return arrays


def _reasons(arrays: dict[str, NDArray[Any]]) -> NDArray[np.uint8]:
    points = arrays["points"]
    reason = np.zeros(len(points), np.uint8)
    with np.errstate(invalid="ignore", over="ignore"):
        if "radius" in arrays:
            reason[~((arrays["radius"] > 0) & (arrays["radius"] < MAX_MAGNITUDE))] = 5
        if "color" in arrays:
            reason[~np.isfinite(arrays["color"]).all(axis=1)] = 4
        if "normals" in arrays:
            length = np.linalg.norm(arrays["normals"], axis=1)
            reason[~((length > 0) & np.isfinite(length))] = 3
        reason[(np.abs(points) > MAX_MAGNITUDE).any(axis=1)] = 2
        reason[~np.isfinite(points).all(axis=1)] = 1
    return reason


def _describe(reason: NDArray[np.uint8]) -> str:
    parts = [f"{count} with {REASONS[r]}" for r, count in enumerate(np.bincount(reason)) if r and count]
    first = int(np.flatnonzero(reason)[0])
    return f"{np.count_nonzero(reason)} of {len(reason)} points ({', '.join(parts)}; the first is point {first})"
