"""Splats that cover a mesh: the Steiner circumellipse of each triangle, after large triangles are halved."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from splatcl.errors import InvalidSplatsError
from splatcl.scene.splats import MAX_MAGNITUDE, MIN_AREA, OnInvalid, Splats, float_array

MAX_SIZE = 0.01
"""Largest half axis of an ellipse, relative to the bounding box's diagonal: it bounds the overhang at silhouettes."""
MAX_SPLATS = 2_000_000
"""Largest number of splats that subdivision makes."""
MIN_ASPECT = 1e-6
"""Least ratio of an ellipse's half axes: below it, the triangle has no area."""
REASONS = ("", "a non-finite or huge number", "no area")


def splats_from_mesh(
    vertices: ArrayLike,
    faces: ArrayLike,
    color: ArrayLike | None = None,
    normals: ArrayLike | None = None,
    *,
    per_face: bool | None = None,
    max_size: float = MAX_SIZE,
    on_invalid: OnInvalid = "error",
    notes: Iterable[str] = (),
) -> Splats:
    """Make splats that cover every triangle of a mesh.

    Triangles without area are skipped; a note gives their number and the first index.

    Parameters
    ----------
    vertices : (V, 3) float array
        World space, scene units; float32 and float64 are kept.
    faces : (F, 3) int array
        Vertex indices, counterclockwise seen from outside.
    color : (V, 3) or (F, 3) float array, optional
        Linear RGB of vertices (a splat gets the mean of its corners) or of faces.
    normals : (V, 3) float array, optional
        Normals of vertices, world space; a triangle whose winding opposes them is turned.
    per_face : bool, optional
        True if `color` has a row for each face. If omitted, its length decides; V = F counts as vertices.
    max_size : float
        Largest half axis of an ellipse, relative to the bounding box's diagonal; larger triangles are halved.
    on_invalid : {"error", "drop"}
        Treatment of triangles with a non-finite or huge corner or color.
    notes : iterable of str
        Sentences that precede the notes on the conversion.

    Returns
    -------
    Splats
        In the order of the faces; the parts of a face are consecutive.

    Raises
    ------
    InvalidSplatsError
        An array has a wrong shape, a face index is out of range, no triangle has an area, or triangles are invalid
        under ``on_invalid="error"``.
    """
    triangles = mesh_triangles(
        vertices, faces, color, normals, per_face=per_face, max_size=max_size, on_invalid=on_invalid, notes=notes
    )
    center, tangent_u, tangent_v = steiner_ellipses(triangles.corners)
    dtype = np.result_type(np.asarray(vertices).dtype, np.float32)
    return Splats(
        center.astype(dtype),
        tangent_u.astype(dtype),
        tangent_v.astype(dtype),
        triangles.mean_color,  # type: ignore[arg-type]
        num_dropped=triangles.num_dropped,
        notes=triangles.notes,
        on_invalid=on_invalid,
    )


@dataclass(frozen=True, eq=False)
class Triangles:
    """The usable triangles of a mesh; large ones are halved."""

    corners: NDArray[np.float64]  # (T, 3, 3), world space
    color: NDArray[np.float64] | None  # (T, 3, 3) colors of the corners, linear RGB
    face: NDArray[np.intp]  # (T,) row in `face_corners` of the face that contains the triangle
    face_corners: NDArray[np.float64]  # (F, 3, 3) usable faces, world space
    num_dropped: int
    notes: tuple[str, ...]

    @property
    def mean_color(self) -> NDArray[np.float32] | None:
        """(T, 3) float32 linear RGB of the triangles, or None."""
        return None if self.color is None else self.color.mean(axis=1).astype(np.float32)


def mesh_triangles(
    vertices: ArrayLike,
    faces: ArrayLike,
    color: ArrayLike | None,
    normals: ArrayLike | None,
    *,
    per_face: bool | None,
    max_size: float,
    on_invalid: OnInvalid,
    notes: Iterable[str],
) -> Triangles:
    """Check a mesh and return its triangles; the parameters and errors are those of `splats_from_mesh`."""
    corners, corner_color, face_normals = _corners(vertices, faces, color, normals, per_face)
    reason = _reasons(corners, corner_color)
    all_notes = [*notes, *_omissions(reason, on_invalid)]
    usable = reason == 0
    if not usable.any():
        raise InvalidSplatsError(f"none of {len(usable)} triangles has finite corners and an area above 1e-15")
    corners, corner_color = corners[usable], None if corner_color is None else corner_color[usable]
    if face_normals is not None:
        flipped = _flip_to(corners, corner_color, face_normals[usable])
        if flipped:
            all_notes.append(f"turned {flipped} triangles to the side of their vertex normals")
    parts, part_color, face = _halve_large(corners, corner_color, max_size)
    halved = "" if len(parts) == len(corners) else f", the large ones halved into {len(parts)} parts"
    all_notes.append(f"covered {len(corners)} triangles by their Steiner ellipses{halved}")
    return Triangles(parts, part_color, face, corners, int(np.count_nonzero(reason == 1)), tuple(all_notes))


def steiner_ellipses(corners: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
    """Return the ellipses of least area through the corners of triangles.

    Parameters
    ----------
    corners : (N, 3, 3) float array
        Triangles; the corners are along the second axis.

    Returns
    -------
    center, tangent_u, tangent_v : (N, 3) float arrays
        Centroids and principal half axes, the longer first; u x v points to the side with counterclockwise corners.
    """
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    center = (a + b + c) / 3
    # Turning conjugate half diameters p, q within the ellipse keeps them conjugate; this turn makes them orthogonal.
    p, q = c - center, (a - b) / np.sqrt(3.0)
    turn = 0.5 * np.arctan2(2 * np.einsum("ni,ni->n", p, q), np.einsum("ni,ni->n", p + q, p - q))
    cos, sin = np.cos(turn)[:, None], np.sin(turn)[:, None]
    return center, cos * p + sin * q, cos * q - sin * p


def face_out_of_range(faces: NDArray[Any], num_vertices: int) -> str | None:
    """Describe the first face with a vertex index out of range, or return None."""
    bad = ((faces < 0) | (faces >= num_vertices)).any(axis=1)
    if not bad.any():
        return None
    face = int(np.flatnonzero(bad)[0])
    numbers = ", ".join(str(int(i)) for i in faces[face])
    return f"face {face} refers to vertices {numbers}; indices must be 0 to {num_vertices - 1}"


def invalid_triangles(
    vertices: ArrayLike, faces: ArrayLike, color: ArrayLike | None = None, per_face: bool | None = None
) -> NDArray[np.uint8]:
    """Return (F,) uint8 indices in `REASONS`: 0 for a usable triangle, else the index of its problem."""
    return _reasons(*_corners(vertices, faces, color, None, per_face)[:2])


def _corners(vertices: Any, faces: Any, color: Any, normals: Any, per_face: bool | None) -> tuple[Any, Any, Any]:
    """Return (F, 3, 3) float64 corners, (F, 3, 3) colors or None, and (F, 3) summed normals or None."""
    points, faces = _floats("vertices", vertices), np.asarray(faces)
    if points.ndim != 2 or points.shape[1] != 3:
        raise InvalidSplatsError(f"vertices have shape {points.shape}; it must be (V, 3)")
    if faces.ndim != 2 or faces.shape[1] != 3 or faces.dtype.kind not in "iu":
        raise InvalidSplatsError(f"faces are {faces.dtype} of shape {faces.shape}; they must be integers, (F, 3)")
    problem = face_out_of_range(faces, len(points))
    if problem:
        raise InvalidSplatsError(problem)
    corner_color = corner_normals = None
    if color is not None:
        rgb = _floats("color", color)
        of_faces = len(rgb) != len(points) if per_face is None else per_face
        if rgb.shape != (faces.shape if of_faces else points.shape):
            raise InvalidSplatsError(
                f"color has shape {rgb.shape}; it must be {points.shape}, or {faces.shape} for faces"
            )
        corner_color = np.repeat(rgb[:, None], 3, axis=1) if of_faces else rgb[faces]
    if normals is not None:
        vertex_normals = _floats("normals", normals)
        if vertex_normals.shape != points.shape:
            raise InvalidSplatsError(f"normals have shape {vertex_normals.shape}; it must be {points.shape}")
        corner_normals = vertex_normals[faces].sum(axis=1)
    return points[faces], corner_color, corner_normals


def _floats(name: str, value: Any) -> NDArray[np.float64]:
    with np.errstate(invalid="ignore"):  # a file may hold a signaling NaN
        return float_array(name, value).astype(np.float64, copy=False)


def _reasons(corners: NDArray[Any], color: NDArray[Any] | None) -> NDArray[np.uint8]:
    """Return (F,) uint8 indices in `REASONS` for (F, 3, 3) corners and colors."""
    parts = [corners] if color is None else [corners, color]
    valid = np.logical_and.reduce([(np.abs(part) <= MAX_MAGNITUDE).all(axis=(1, 2)) for part in parts])
    _, u, v = steiner_ellipses(np.where(valid[:, None, None], corners, 0.0))
    long, short = np.linalg.norm(u, axis=1), np.linalg.norm(v, axis=1)
    flat = (long * short < 2 * MIN_AREA) | (short < MIN_ASPECT * long)
    return np.select([~valid, flat], [1, 2], 0).astype(np.uint8)


def _omissions(reason: NDArray[np.uint8], on_invalid: OnInvalid) -> list[str]:
    """Return notes on dropped and skipped triangles; raise for dropped ones under ``on_invalid="error"``."""
    notes = []
    if (reason == 1).any():
        text = _describe(reason, 1)
        if on_invalid == "error":
            raise InvalidSplatsError(f"{text}; drop them with on_invalid='drop'")
        notes.append(f"dropped {text}")
    if (reason == 2).any():
        notes.append(f"skipped {_describe(reason, 2)}")
    return notes


def _describe(reason: NDArray[np.uint8], problem: int) -> str:
    bad = np.flatnonzero(reason == problem)
    return f"{len(bad)} of {len(reason)} triangles with {REASONS[problem]} (the first is face {bad[0]})"


def _flip_to(corners: NDArray[Any], color: NDArray[Any] | None, normals: NDArray[Any]) -> int:
    """Swap two corners, in place, of each triangle whose winding opposes its normal; return their number."""
    winding = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    against = np.einsum("ni,ni->n", winding, normals) < 0
    for array in (corners,) if color is None else (corners, color):
        array[against] = array[against][:, [0, 2, 1]]
    return int(np.count_nonzero(against))


def _halve_large(
    corners: NDArray[Any], color: NDArray[Any] | None, max_size: float
) -> tuple[NDArray[Any], NDArray[Any] | None, NDArray[np.intp]]:
    """Halve triangles at their longest edges until no half axis is longer than `max_size` times the diagonal.

    Returns
    -------
    corners : (T, 3, 3) array
    color : (T, 3, 3) array or None
    source : (T,) int array
        The input triangle that contains each triangle.
    """
    vertices = corners.reshape(-1, 3)
    limit = max_size * float(np.linalg.norm(vertices.max(axis=0) - vertices.min(axis=0)))
    source = np.arange(len(corners))
    while True:
        large = np.linalg.norm(steiner_ellipses(corners)[1], axis=1) > limit
        num = len(corners) + np.count_nonzero(large)
        if not large.any() or num > MAX_SPLATS:
            return corners, color, source
        # Two copies replace each large triangle; in each, the midpoint replaces one end of the longest edge.
        edges = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2)
        start = edges.argmax(axis=1)
        parts = np.repeat(np.arange(len(corners)), 1 + large)
        split = np.flatnonzero(large[parts])
        end = np.where(np.arange(len(split)) % 2, start[parts[split]], (start[parts[split]] + 1) % 3)
        arrays = []
        for array in (corners,) if color is None else (corners, color):
            rows = np.arange(len(array))
            middle = 0.5 * (array[rows, start] + array[rows, (start + 1) % 3])
            halves = array[parts]
            halves[split, end] = middle[parts[split]]
            arrays.append(halves)
        corners, color = arrays[0], None if color is None else arrays[1]
        source = source[parts]
