"""Splats that cover a mesh: the Steiner circumellipse of each triangle, large triangles halved first."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from splatcl.errors import InvalidSplatsError
from splatcl.scene.splats import MAX_MAGNITUDE, MIN_AREA, OnInvalid, Splats

MAX_SIZE = 0.01
"""Largest half axis of an ellipse, as a share of the bounding box's diagonal: it bounds how far a silhouette
juts out."""
MAX_SPLATS = 2_000_000
"""Subdivision stops before it makes more splats than this."""
MIN_ASPECT = 1e-6
"""A triangle has no area where its ellipse's half axes are in a smaller ratio than this."""
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

    Triangles of no area are skipped, for they cover nothing; a note says how many and which is the first.

    Parameters
    ----------
    vertices : (V, 3) float array
        World space, scene units; float32 and float64 are kept.
    faces : (F, 3) int array
        Vertex indices, counter-clockwise seen from outside.
    color : (V, 3) or (F, 3) float array, optional
        Linear RGB of vertices (a splat gets the mean of its corners) or of faces.
    normals : (V, 3) float array, optional
        Of vertices; they turn a triangle whose winding points the other way.
    per_face : bool, optional
        Whether `color` is of faces; by its length where omitted (of vertices where V = F).
    max_size : float
        Triangles whose ellipse is longer than this share of the bounding box's diagonal are halved.
    on_invalid : {"error", "drop"}
        What to do with triangles that have a non-finite or huge corner or color.
    notes : iterable of str
        Sentences to put before the ones about the conversion.

    Returns
    -------
    Splats
        In the order of the faces; the halves of a face follow each other.

    Raises
    ------
    InvalidSplatsError
        Wrong shapes, a face index out of range, no triangle with an area, or invalid triangles under
        ``on_invalid="error"``.
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
    """The usable triangles of a mesh, the large ones halved."""

    corners: NDArray[np.float64]  # (T, 3, 3), world space
    color: NDArray[np.float64] | None  # (T, 3, 3) of the corners, linear RGB
    face: NDArray[np.intp]  # (T,) the row of `face_corners` that each is part of
    face_corners: NDArray[np.float64]  # (F, 3, 3) the usable faces
    num_dropped: int
    notes: tuple[str, ...]

    @property
    def mean_color(self) -> NDArray[np.float32] | None:
        """(T, 3) linear RGB of the triangles, or None."""
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
    """Check a mesh and return its triangles; parameters and errors are those of `splats_from_mesh`."""
    corners, corner_color, face_normals = _corners(vertices, faces, color, normals, per_face)
    reason = _reasons(corners, corner_color)
    all_notes = [*notes, *_left_out(reason, on_invalid)]
    solid = reason == 0
    if not solid.any():
        raise InvalidSplatsError(f"none of {len(solid)} triangles has finite corners and an area above 1e-15")
    corners, corner_color = corners[solid], None if corner_color is None else corner_color[solid]
    if face_normals is not None:
        flipped = _flip_to(corners, corner_color, face_normals[solid])
        if flipped:
            all_notes.append(f"turned {flipped} triangles to the side of their vertex normals")
    parts, part_color, face = _halve_large(corners, corner_color, max_size)
    halved = "" if len(parts) == len(corners) else f", the large ones halved into {len(parts)} parts"
    all_notes.append(f"covered {len(corners)} triangles by their Steiner ellipses{halved}")
    return Triangles(parts, part_color, face, corners, int(np.count_nonzero(reason == 1)), tuple(all_notes))


def steiner_ellipses(corners: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
    """Return the least-area ellipses through the corners of triangles.

    Parameters
    ----------
    corners : (N, 3, 3) float array
        Triangles, corners along the second axis.

    Returns
    -------
    center, tangent_u, tangent_v : (N, 3) float arrays
        Centroids and principal half axes, the longer first; u x v is on the side that the winding gives.
    """
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    center = (a + b + c) / 3
    # Conjugate half-diameters p, q; turning them by t within the ellipse keeps them conjugate.
    p, q = c - center, (a - b) / np.sqrt(3.0)
    turn = 0.5 * np.arctan2(2 * np.einsum("ni,ni->n", p, q), np.einsum("ni,ni->n", p + q, p - q))
    cos, sin = np.cos(turn)[:, None], np.sin(turn)[:, None]
    return center, cos * p + sin * q, cos * q - sin * p


def face_out_of_range(faces: NDArray[Any], num_vertices: int) -> str | None:
    """Say which face refers to a vertex that does not exist, or return None."""
    bad = ((faces < 0) | (faces >= num_vertices)).any(axis=1)
    if not bad.any():
        return None
    face = int(np.flatnonzero(bad)[0])
    numbers = ", ".join(str(int(i)) for i in faces[face])
    return f"face {face} refers to vertices {numbers}, but there are {num_vertices} (0 to {num_vertices - 1})"


def invalid_triangles(
    vertices: ArrayLike, faces: ArrayLike, color: ArrayLike | None = None, per_face: bool | None = None
) -> NDArray[np.uint8]:
    """Return (F,) uint8: 0 for a usable triangle, else the index in `REASONS` of what is wrong with it."""
    return _reasons(*_corners(vertices, faces, color, None, per_face)[:2])


def _corners(vertices: Any, faces: Any, color: Any, normals: Any, per_face: bool | None) -> tuple[Any, Any, Any]:
    """Return (F, 3, 3) float64 corners, their (F, 3, 3) colors and (F, 3) summed normals, or None."""
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
        shade = _floats("color", color)
        of_faces = len(shade) != len(points) if per_face is None else per_face
        if shade.shape != (faces.shape if of_faces else points.shape):
            raise InvalidSplatsError(
                f"color has shape {shade.shape}; it must be {points.shape}, or {faces.shape} for faces"
            )
        corner_color = np.repeat(shade[:, None], 3, axis=1) if of_faces else shade[faces]
    if normals is not None:
        turned = _floats("normals", normals)
        if turned.shape != points.shape:
            raise InvalidSplatsError(f"normals have shape {turned.shape}; it must be {points.shape}")
        corner_normals = turned[faces].sum(axis=1)
    return points[faces], corner_color, corner_normals


def _floats(name: str, value: Any) -> NDArray[np.float64]:
    try:
        with np.errstate(invalid="ignore"):  # signaling NaN
            return np.asarray(value, np.float64)
    except (TypeError, ValueError) as error:
        raise InvalidSplatsError(f"{name} is not an array of numbers ({error})") from None


def _reasons(corners: NDArray[Any], color: NDArray[Any] | None) -> NDArray[np.uint8]:
    parts = [corners] if color is None else [corners, color]
    valid = np.logical_and.reduce([(np.abs(part) <= MAX_MAGNITUDE).all(axis=(1, 2)) for part in parts])
    _, u, v = steiner_ellipses(np.where(valid[:, None, None], corners, 0.0))
    long, short = np.linalg.norm(u, axis=1), np.linalg.norm(v, axis=1)
    flat = (long * short < 2 * MIN_AREA) | (short < MIN_ASPECT * long)
    return np.select([~valid, flat], [1, 2], 0).astype(np.uint8)


def _left_out(reason: NDArray[np.uint8], on_invalid: OnInvalid) -> list[str]:
    """Say which triangles are dropped, an error under ``on_invalid="error"``, and which are skipped."""
    notes = []
    if (reason == 1).any():
        text = _describe(reason, 1)
        if on_invalid == "error":
            raise InvalidSplatsError(f"{text}; drop them with on_invalid='drop'")
        notes.append(f"dropped {text}")
    if (reason == 2).any():
        notes.append(f"skipped {_describe(reason, 2)}")
    return notes


def _describe(reason: NDArray[np.uint8], which: int) -> str:
    bad = np.flatnonzero(reason == which)
    return f"{len(bad)} of {len(reason)} triangles with {REASONS[which]} (the first is face {bad[0]})"


def _flip_to(corners: NDArray[Any], color: NDArray[Any] | None, normals: NDArray[Any]) -> int:
    """Swap two corners, in place, of triangles that wind against `normals`; return how many."""
    winding = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    against = np.einsum("ni,ni->n", winding, normals) < 0
    for array in (corners,) if color is None else (corners, color):
        array[against] = array[against][:, [0, 2, 1]]
    return int(np.count_nonzero(against))


def _halve_large(
    corners: NDArray[Any], color: NDArray[Any] | None, max_size: float
) -> tuple[NDArray[Any], NDArray[Any] | None, NDArray[np.intp]]:
    """Halve triangles at their longest edge until no ellipse is longer than `max_size` of the diagonal.

    The third array says which triangle each is a part of.
    """
    spread = corners.reshape(-1, 3)
    limit = max_size * float(np.linalg.norm(spread.max(axis=0) - spread.min(axis=0)))
    source = np.arange(len(corners))
    while True:
        large = np.linalg.norm(steiner_ellipses(corners)[1], axis=1) > limit
        num = len(corners) + np.count_nonzero(large)
        if not large.any() or num > MAX_SPLATS:
            return corners, color, source
        # Each large triangle is replaced in place by two: its longest edge's ends give way to the midpoint.
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
