"""Estimate splats for points: normals from the nearest neighbors, tangent axes from the Voronoi cell.

Discs leave no holes if each covers its point's Voronoi cell in the tangent plane. Each disc is therefore (nearly)
the least ellipse about its point that contains the cell.
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
from splatcl.scene.splats import MAX_MAGNITUDE, OnInvalid, Splats, describe_reasons, float_array

NUM_NEIGHBORS = 20
"""Default number of nearest neighbors for an estimate."""
SPACING_NEIGHBOR = 6
"""Rank of a neighbor; its distance is the point's spacing. A point on a surface has about six direct neighbors."""
REACH = 1.75
"""Limit of a Voronoi vertex's distance, in spacings: a farther vertex lies beyond the surface's boundary."""
MARGIN = 1.05
"""Ratio of a disc's size to its cell's size: discs are tilted against each other on a curved surface."""
LONE_RADIUS = 1.0
"""Radius of a point without another point at a distance, scene units."""
CHUNK = 2048
"""Points per chunk: the temporaries, a few MB for each thread, fit into its cache."""
MIN_GAP = 1e-3
"""Least gap of a matrix's two least eigenvalues, about, relative to its size; LAPACK solves a matrix below it."""

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
    """Make splats that cover the surface of a point cloud.

    Parameters
    ----------
    points : (N, 3) float array
        World space, scene units; float32 and float64 are kept.
    normals : (N, 3) float array, optional
        World space, any length but zero. Estimated if omitted, with arbitrary signs (``oriented=False``).
    color : (N, 3) float array, optional
        Linear RGB.
    radius : (N,) or scalar float array, optional
        Radii of circular discs, scene units. Ellipses are estimated if omitted.
    num_neighbors : int
        Number of nearest neighbors for an estimate, at least 3.
    on_invalid : {"error", "drop"}
        Treatment of unusable points.
    notes : iterable of str
        Sentences that precede the notes on the estimates.

    Returns
    -------
    Splats
        One splat for each usable point, in order.

    Raises
    ------
    InvalidSplatsError
        An array has a wrong shape, there are no points, or points are unusable under ``on_invalid="error"``.
    """
    arrays = _arrays(points, normals, color, radius)
    reason = _reasons(arrays)
    all_notes = list(notes)
    num_dropped = int(np.count_nonzero(reason))
    if num_dropped:
        text = describe_reasons(reason, REASONS, "point")
        if on_invalid == "error":
            raise InvalidSplatsError(f"{text}; drop them with on_invalid='drop'")
        arrays = {name: array[reason == 0] for name, array in arrays.items()}
        all_notes.append(f"dropped {text}")
    if not len(arrays["points"]):
        raise InvalidSplatsError(f"none of {len(reason)} points is usable; give at least one with finite coordinates")
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
    """Return (N,) uint8 indices in `REASONS`: 0 for a usable point, else the index of its problem."""
    return _reasons(_arrays(points, normals, color, radius))


def estimate_spacing(points: ArrayLike, max_samples: int = 50_000) -> float:
    """Return the median distance from a point to its nearest distinct neighbor, scene units; 0 without one.

    At most `max_samples` points, evenly chosen, are measured against all points.
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
    """Return (2, N, 3) tangent axes, world space, and notes on the estimates."""
    points, normals, radius = arrays["points"], arrays.get("normals"), arrays.get("radius")
    if normals is not None:
        normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    if normals is not None and radius is not None:
        return np.stack(tangent_frame(normals)) * radius[:, None], ()
    # A survey's large coordinates would cost precision.
    local = points.astype(np.float64) - points.mean(axis=0, dtype=np.float64)
    tangents, used = _estimate(local, normals, num_neighbors)
    estimated = [] if normals is not None else [f"normals (PCA, {used} neighbors)"]
    if radius is not None:
        with np.errstate(invalid="ignore"):
            tangents *= (radius / np.linalg.norm(tangents, axis=2))[..., None]
    else:
        median = np.median(np.linalg.norm(tangents, axis=2).max(axis=0))
        estimated.append(f"radii (median {median:.3g})")
    return tangents, (f"estimated {' and '.join(estimated)} for {len(points)} points",)


def _estimate(
    points: NDArray[np.float64], normals: NDArray[np.float64] | None, num_neighbors: int
) -> tuple[NDArray[np.float64], int]:
    """Return (2, N, 3) tangent axes and the number of neighbors of each estimate."""
    distinct, (tree, spacing, nearest) = points, _tree(points)
    order = tree.indices  # in this order neighboring points follow each other, which makes searches twice as fast
    if len(points) > 1 and not nearest.min() > 0:
        distinct = np.unique(points, axis=0)  # coincident points are no neighbors of each other
        tree, spacing, _ = _tree(distinct)
    num_neighbors = min(num_neighbors, len(distinct) - 1)
    tangents = np.empty((2, len(points), 3))

    coordinates = np.ascontiguousarray(distinct.T)

    def estimate(start: int) -> None:
        chunk = order[start : start + CHUNK]
        centers = points[chunk]
        ids = np.ascontiguousarray(tree.query(centers, num_neighbors + 1)[1].T)
        offsets = coordinates[:, ids[1:]] - centers.T[:, None]
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
    """Fit a plane to each point and its (3, K, N) neighbors, relative to the point; return (N, 3) unit normals.

    The largest component of a normal is positive.
    """
    total = offsets.shape[1] + 1
    mean = offsets.sum(axis=1) / total
    pairs = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
    covariance = np.stack([(offsets[i] * offsets[j]).sum(axis=0) / total - mean[i] * mean[j] for i, j in pairs])
    normals = least_eigenvectors(covariance)
    rows = np.arange(len(normals))
    return normals * np.sign(normals[rows, np.abs(normals).argmax(axis=1)])[:, None]


def least_eigenvectors(matrices: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (N, 3) unit eigenvectors of the least eigenvalues of symmetric 3x3 matrices.

    Parameters
    ----------
    matrices : (6, N) float64 array
        Elements xx, xy, xz, yy, yz, zz.
    """
    xx, xy, xz, yy, yz, zz = matrices
    # The least root of the characteristic polynomial (Smith 1961) of (M - mean I) / size.
    mean = (xx + yy + zz) / 3
    squares = (xx - mean) ** 2 + (yy - mean) ** 2 + (zz - mean) ** 2 + 2 * (xy * xy + xz * xz + yz * yz)
    size = np.sqrt(squares / 6)
    scale = 1 / np.where(size > 0, size, 1.0)
    a, b, c = (xx - mean) * scale, (yy - mean) * scale, (zz - mean) * scale
    d, e, f = xy * scale, xz * scale, yz * scale
    determinant = a * (b * c - f * f) - d * (d * c - e * f) + e * (d * f - b * e)
    least = 2 * np.cos(np.arccos(np.clip(determinant / 2, -1.0, 1.0)) / 3 + 2 * np.pi / 3)
    # The other two eigenvectors span the rows of the matrix less its least root, so a cross product of two rows is
    # along the first. The longest product has the least rounding error.
    rows = np.array([[a - least, d, e], [d, b - least, f], [e, f, c - least]])
    products = np.array([_cross(rows[i], rows[j]) for i, j in ((0, 1), (1, 2), (2, 0))])
    lengths = np.sqrt((products**2).sum(axis=1))
    longest = lengths.argmax(axis=0)
    n = np.arange(len(mean))
    length = lengths[longest, n]
    degenerate = ~(length > MIN_GAP)
    vectors: NDArray[np.float64] = products[longest, :, n] / np.where(degenerate, 1.0, length)[:, None]
    if degenerate.any():
        full = matrices[:, degenerate][[0, 1, 2, 1, 3, 4, 2, 4, 5]].T.reshape(-1, 3, 3)
        vectors[degenerate] = np.linalg.eigh(full)[1][:, :, 0]
    return vectors


def _cross(a: Any, b: Any) -> list[Any]:
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def _tree(points: NDArray[np.float64]) -> tuple[Any, NDArray[np.float64], NDArray[np.float64]]:
    """Return a search tree, (N,) distances to the `SPACING_NEIGHBOR`th neighbor and (N,) to the nearest one."""
    from scipy.spatial import KDTree

    tree: Any = KDTree(points)
    distance = np.zeros((len(points), 2))
    if len(points) > 1:
        k = min(SPACING_NEIGHBOR + 1, len(points))
        distance[tree.indices] = tree.query(points[tree.indices], [2, k], workers=-1)[0]
    return tree, distance[:, 1], distance[:, 0]


def _arrays(points: ArrayLike, normals: Any, color: Any, radius: Any) -> dict[str, NDArray[Any]]:
    """Convert the given arrays to floats and check their shapes; all but `normals` keep float32 and float64."""
    given = {"points": points, "normals": normals, "color": color, "radius": radius}
    arrays: dict[str, NDArray[Any]] = {}
    for name, value in given.items():
        if value is None:
            continue
        array = float_array(name, value)
        if name == "normals":
            array = array.astype(np.float64)
        num = len(arrays["points"]) if arrays else len(array) if array.ndim else 0
        if name == "radius" and array.ndim == 0:
            array = np.full(num, array)
        shape = (num,) if name == "radius" else (num, 3)
        if array.shape != shape:
            raise InvalidSplatsError(f"{name} has shape {array.shape}; it must be {shape}")
        arrays[name] = array
    return arrays


def _reasons(arrays: dict[str, NDArray[Any]]) -> NDArray[np.uint8]:
    """Return (N,) uint8 indices in `REASONS`; of several problems, the first in the list counts."""
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
