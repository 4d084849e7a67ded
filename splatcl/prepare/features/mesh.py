"""Splats of a mesh that end at its sharp edges ([ZRB04] section 5)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from splatcl.errors import SettingsError
from splatcl.prepare.features.clip_lines import MAX_LINES, evaluate, keep_deepest, plane_lines
from splatcl.prepare.features.sharp_edges import SharpEdges, sharp_edges
from splatcl.prepare.meshes import MAX_SIZE, MAX_SPLATS, mesh_triangles, steiner_ellipses
from splatcl.scene.splats import OnInvalid, Splats

Array = NDArray[Any]
ANGLE = 30.0
"""Default largest angle between the normals of two faces at a smooth edge, degrees."""
MAX_ROUNDS = 4
"""Largest number of times that a triangle is split into four so that two lines are enough."""
INSIDE = 1e-6
"""Least length of an edge's part inside a clipped disc, disc coordinates: a shorter part does not count."""


def mesh_features(
    vertices: ArrayLike,
    faces: ArrayLike,
    color: ArrayLike | None = None,
    normals: ArrayLike | None = None,
    *,
    angle: float = ANGLE,
    per_face: bool | None = None,
    max_size: float = MAX_SIZE,
    on_invalid: OnInvalid = "error",
    notes: Iterable[str] = (),
) -> Splats:
    """Make splats that cover every triangle of a mesh and end at its sharp edges.

    Each triangle gets its Steiner ellipse, as in `splats_from_mesh`. A clip line cuts an ellipse off at each sharp
    edge that it reaches over. No line cuts the splat's own triangle, so no hole opens.

    A triangle whose ellipse needs more than two lines is split into four at the midpoints of its edges, repeatedly.
    Then each corner triangle needs at most two lines, and the middle ellipse lies within the triangle.

    Parameters
    ----------
    vertices, faces, color, normals, per_face, max_size, on_invalid, notes
        As for `splats_from_mesh`. Coincident vertices count as one.
    angle : float
        Degrees, 0 to 180. An edge is sharp if the normals of its two faces differ by more. An edge of one face, or of
        three or more, is always sharp.

    Returns
    -------
    Splats
        float64, in the order of the faces, with `clip`. The notes count sharp edges, cut splats, split triangles, and
        edges that splats still reach over.

    Raises
    ------
    SettingsError
        `angle` is out of range.
    InvalidSplatsError
        As for `splats_from_mesh`.
    """
    if not 0 <= angle <= 180:
        raise SettingsError(f"angle {angle} must be between 0 and 180 degrees")
    triangles = mesh_triangles(
        vertices, faces, color, normals, per_face=per_face, max_size=max_size, on_invalid=on_invalid, notes=notes
    )
    edges = sharp_edges(triangles.face_corners, angle)
    corner_color = np.empty((len(triangles.corners), 3, 0)) if triangles.color is None else triangles.color
    pending = _Parts(triangles.corners, corner_color, triangles.face)
    done: list[_Parts] = []
    done_clip: list[Array] = []
    num_done = num_split = num_unclipped = 0
    for round_ in range(MAX_ROUNDS + 1):
        clip, lost = _clip(pending, edges)
        split = np.unique(lost)
        if round_ == MAX_ROUNDS or num_done + len(pending) + 3 * len(split) > MAX_SPLATS:
            num_unclipped, split = len(lost), split[:0]
        final = np.setdiff1d(np.arange(len(pending)), split)
        done.append(pending.take(final))
        done_clip.append(clip[final])
        num_done, num_split = num_done + len(final), num_split + len(split)
        pending = pending.take(split).quarters()
        if not len(pending):
            break
    parts, clip = _Parts.joined(done), np.concatenate(done_clip)
    order = np.argsort(parts.face, kind="stable")
    parts, clip = parts.take(order), clip[order]
    center, tangent_u, tangent_v = steiner_ellipses(parts.corners)
    return Splats(
        center,
        tangent_u,
        tangent_v,
        None if triangles.color is None else parts.color.mean(axis=1).astype(np.float32),  # type: ignore[arg-type]
        num_dropped=triangles.num_dropped,
        notes=(*triangles.notes, *_notes(edges, clip, angle, num_split, num_unclipped)),
        on_invalid=on_invalid,
        clip=clip,
    )


def _notes(edges: SharpEdges, clip: Array, angle: float, num_split: int, num_unclipped: int) -> list[str]:
    cut = np.count_nonzero(clip.any(axis=(1, 2)))
    notes = [f"cut {cut} of {len(clip)} splats off at {edges.num_edges} edges sharper than {angle:g} degrees"]
    notes += [f"split {num_split} triangles into four at sharp edges"] if num_split else []
    notes += [f"splats still reach over sharp edges at {num_unclipped} places"] if num_unclipped else []
    return notes


@dataclass(frozen=True, eq=False)
class _Parts:
    """Triangles, each a part of a face."""

    corners: Array  # (T, 3, 3), world space
    color: Array  # (T, 3, 3) of the corners, linear RGB; (T, 3, 0) without colors
    face: Array  # (T,) the face that contains the triangle

    def __len__(self) -> int:
        return len(self.corners)

    def take(self, ids: Array) -> _Parts:
        return _Parts(self.corners[ids], self.color[ids], self.face[ids])

    def quarters(self) -> _Parts:
        """Split each triangle into four, three corners and the middle; return 4 T triangles."""
        return _Parts(_quarters(self.corners), _quarters(self.color), np.repeat(self.face, 4))

    @staticmethod
    def joined(parts: list[_Parts]) -> _Parts:
        return _Parts(*(np.concatenate([getattr(p, name) for p in parts]) for name in ("corners", "color", "face")))


def _quarters(corners: Array) -> Array:
    """Split (T, 3, C) values of triangles at the midpoints of the edges; return (4 T, 3, C)."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    ab, bc, ca = 0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a)
    four = [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
    return np.stack([np.stack(part, axis=1) for part in four], axis=1).reshape(4 * len(corners), *corners.shape[1:])


def _clip(parts: _Parts, edges: SharpEdges) -> tuple[Array, Array]:
    """Clip the ellipses of the parts at sharp edges.

    Returns
    -------
    clip : (T, 2, 3) float64 array
        Clip lines, disc coordinates.
    unclipped : (U,) int array
        The part of each edge that its splat still reaches over.
    """
    if not len(edges) or not len(parts):
        return np.zeros((len(parts), MAX_LINES, 3)), np.empty(0, np.intp)
    center, tangent_u, tangent_v = steiner_ellipses(parts.corners)
    owner, side = _near_pairs(center, np.linalg.norm(tangent_u, axis=1), edges)
    normal = np.cross(tangent_u, tangent_v)
    keep = edges.patch[side] == edges.patch_of_face[parts.face[owner]]
    keep &= (normal[owner] * edges.normal[side]).sum(axis=1) > 0
    owner, side = owner[keep], side[keep]
    c, u, v = center[owner], tangent_u[owner], tangent_v[owner]
    lines = plane_lines(c, u, v, edges.start[side], edges.inward[side])
    start, end = (_disc_coordinates(p[side] - c, u, v) for p in (edges.start, edges.end))
    crosses = lines.any(axis=1) & _crosses_disc(start, end, np.zeros((len(side), MAX_LINES, 3)))
    owner, lines, start, end = owner[crosses], lines[crosses], start[crosses], end[crosses]
    c, u, v = c[crosses], u[crosses], v[crosses]
    # A line through the splat's own triangle would tear a hole, so a line must keep the triangle's corners.
    corners = np.stack([_disc_coordinates(parts.corners[owner, k] - c, u, v) for k in range(3)], axis=1)
    lowest = evaluate(lines[:, None], corners).min(axis=1)
    lines[:, 2] += np.maximum(-lowest, 0) * (lowest > -INSIDE)
    usable = lowest > -INSIDE
    clip, lost = keep_deepest(
        owner[usable], lines[usable], len(parts), lambda clip: _crosses_disc(start[usable], end[usable], clip)
    )
    # If the splat's center is inward of an unusable edge, the splat reaches over it. If it is beyond, the edge ends
    # another surface: a sheet underneath, or the other side of a crease.
    unusable = ~usable & (lines[:, 2] > 0) & _crosses_disc(start, end, clip[owner])
    return clip, np.concatenate([owner[usable][lost], owner[unusable]])


def _near_pairs(center: Array, radius: Array, edges: SharpEdges) -> tuple[Array, Array]:
    """Return pairs of a splat and an edge that include all pairs within the splat's radius."""
    length = np.linalg.norm(edges.end - edges.start, axis=1)
    pieces = np.maximum(np.ceil(length / radius.max()), 1).astype(np.intp)
    edge = np.repeat(np.arange(len(edges)), pieces)
    fraction = (np.arange(len(edge)) - np.repeat(np.cumsum(pieces) - pieces, pieces) + 0.5) / pieces[edge]
    tree = cKDTree(edges.start[edge] + fraction[:, None] * (edges.end - edges.start)[edge])
    reach = radius + 0.5 * (length / pieces).max()
    close = np.flatnonzero(tree.query(center, distance_upper_bound=reach.max())[0] <= reach)
    found = tree.query_ball_point(center[close], reach[close])
    owner = np.repeat(close, [len(f) for f in found])
    side = edge[np.array([piece for f in found for piece in f], np.intp)]
    pairs = np.unique(owner * len(edges) + side)
    return np.divmod(pairs, len(edges))


def _disc_coordinates(offset: Array, tangent_u: Array, tangent_v: Array) -> Array:
    """Project (N, 3) points relative to the discs' centers, world space, along the normals; return (N, 2) u and v."""
    return np.stack([(offset * t).sum(axis=1) / (t * t).sum(axis=1) for t in (tangent_u, tangent_v)], axis=1)


def _crosses_disc(start: Array, end: Array, clip: Array) -> Array:
    """Return (N,) bool: whether segments, (N, 2) disc coordinates, cross the inside of the clipped discs."""
    step = end - start
    a, b, c = (step**2).sum(axis=1), (start * step).sum(axis=1), (start**2).sum(axis=1) - 1
    with np.errstate(divide="ignore", invalid="ignore"):
        half = np.sqrt(b * b - a * c)
        first, last = np.fmax((-b - half) / a, 0.0), np.fmin((half - b) / a, 1.0)
        for k in range(MAX_LINES):
            line = clip[:, k]
            cuts = line.any(axis=1)
            f, g = (np.where(cuts, evaluate(line, p) - INSIDE, 1.0) for p in (start, end))
            crossing = f / (f - g)
            first = np.where(f < 0, np.where(g < 0, np.inf, np.maximum(first, crossing)), first)
            last = np.where((g < 0) & (f >= 0), np.minimum(last, crossing), last)
        crosses: Array = (half > 0) & ((last - first) * np.sqrt(a) > INSIDE)
    return crosses
