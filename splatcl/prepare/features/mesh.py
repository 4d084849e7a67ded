"""Splats of a mesh that end at its sharp edges."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from splatcl.errors import SettingsError
from splatcl.prepare.features.clip_lines import MAX_LINES, at, keep_deepest, plane_lines
from splatcl.prepare.features.sharp_edges import SharpEdges, sharp_edges
from splatcl.prepare.meshes import MAX_SIZE, MAX_SPLATS, mesh_triangles, steiner_ellipses
from splatcl.scene.splats import OnInvalid, Splats

Array = NDArray[Any]
ANGLE = 30.0
"""Degrees between the normals of two faces above which their edge is sharp."""
MAX_ROUNDS = 4
"""Times that a triangle is parted into four so that two lines are enough."""
INSIDE = 1e-6
"""An edge meets what is left of a disc along more than this share of its radius, or it does not."""


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
    """Make splats that cover every triangle of a mesh and are cut off at its sharp edges.

    Each triangle is covered by its Steiner ellipse, as by `splats_from_mesh`. Where an ellipse reaches over a sharp
    edge it is cut off along that edge, but never through its own triangle, so that no hole can open. A triangle
    whose ellipse needs more than two lines is parted into four by the midpoints of its edges, again and again: its
    corners need two lines at most, and the ellipse of the middle one stays within the triangle.

    Parameters
    ----------
    vertices, faces, color, normals, per_face, max_size, on_invalid, notes
        As for `splats_from_mesh`. Vertices at the same place are one.
    angle : float
        Degrees, 0 to 180. An edge is sharp if the normals of its two faces differ by more, or if it is of one face
        only, or of three or more.

    Returns
    -------
    Splats
        float64, in the order of the faces, with `clip`. The notes count sharp edges, cut and parted triangles, and
        edges that splats still reach over.

    Raises
    ------
    SettingsError
        `angle` is out of its range.
    InvalidSplatsError
        As for `splats_from_mesh`.
    """
    if not 0 <= angle <= 180:
        raise SettingsError(f"angle {angle} must be between 0 and 180 degrees")
    triangles = mesh_triangles(
        vertices, faces, color, normals, per_face=per_face, max_size=max_size, on_invalid=on_invalid, notes=notes
    )
    edges = sharp_edges(triangles.face_corners, angle)
    shade = np.empty((len(triangles.corners), 3, 0)) if triangles.color is None else triangles.color
    todo = _Parts(triangles.corners, shade, triangles.face)
    done: list[_Parts] = []
    done_clip: list[Array] = []
    num_done = num_parted = num_over = 0
    for round_ in range(MAX_ROUNDS + 1):
        clip, lost = _clip(todo, edges)
        over = np.unique(lost)
        if round_ == MAX_ROUNDS or num_done + len(todo) + 3 * len(over) > MAX_SPLATS:
            num_over, over = len(lost), over[:0]
        whole = np.setdiff1d(np.arange(len(todo)), over)
        done.append(todo.take(whole))
        done_clip.append(clip[whole])
        num_done, num_parted = num_done + len(whole), num_parted + len(over)
        todo = todo.take(over).quarters()
        if not len(todo):
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
        notes=(*triangles.notes, *_notes(edges, clip, angle, num_parted, num_over)),
        on_invalid=on_invalid,
        clip=clip,
    )


def _notes(edges: SharpEdges, clip: Array, angle: float, num_parted: int, num_over: int) -> list[str]:
    cut = np.count_nonzero(clip.any(axis=(1, 2)))
    notes = [f"cut {cut} of {len(clip)} splats off at {edges.num_edges} edges sharper than {angle:g} degrees"]
    notes += [f"parted {num_parted} triangles into four at sharp edges"] if num_parted else []
    notes += [f"splats still reach over sharp edges at {num_over} places"] if num_over else []
    return notes


@dataclass(frozen=True, eq=False)
class _Parts:
    """Parts of faces."""

    corners: Array  # (T, 3, 3)
    color: Array  # (T, 3, 3), or (T, 3, 0) without colors
    face: Array  # (T,)

    def __len__(self) -> int:
        return len(self.corners)

    def take(self, ids: Array) -> _Parts:
        return _Parts(self.corners[ids], self.color[ids], self.face[ids])

    def quarters(self) -> _Parts:
        """Return (4 T) triangles: the three corners and the middle of each."""
        return _Parts(_quarters(self.corners), _quarters(self.color), np.repeat(self.face, 4))

    @staticmethod
    def joined(parts: list[_Parts]) -> _Parts:
        return _Parts(*(np.concatenate([getattr(p, name) for p in parts]) for name in ("corners", "color", "face")))


def _quarters(corners: Array) -> Array:
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    ab, bc, ca = 0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a)
    four = [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
    return np.stack([np.stack(part, axis=1) for part in four], axis=1).reshape(4 * len(corners), *corners.shape[1:])


def _clip(parts: _Parts, edges: SharpEdges) -> tuple[Array, Array]:
    """Return the (T, 2, 3) lines of the parts, and of which part each edge is that its splat still reaches over."""
    if not len(edges) or not len(parts):
        return np.zeros((len(parts), MAX_LINES, 3)), np.empty(0, np.intp)
    center, tangent_u, tangent_v = steiner_ellipses(parts.corners)
    owner, side = _near(center, np.linalg.norm(tangent_u, axis=1), edges)
    normal = np.cross(tangent_u, tangent_v)
    keep = edges.patch[side] == edges.patch_of_face[parts.face[owner]]
    keep &= (normal[owner] * edges.normal[side]).sum(axis=1) > 0
    owner, side = owner[keep], side[keep]
    c, u, v = center[owner], tangent_u[owner], tangent_v[owner]
    lines = plane_lines(c, u, v, edges.start[side], edges.inward[side])
    start, end = (_disc_coordinates(p[side] - c, u, v) for p in (edges.start, edges.end))
    met = lines.any(axis=1) & _meets(start, end, np.zeros((len(side), MAX_LINES, 3)))
    owner, side, lines, start, end = owner[met], side[met], lines[met], start[met], end[met]
    # A line through the splat's own triangle would tear a hole: the triangle's corners are all kept.
    corners = np.stack([_disc_coordinates(parts.corners[owner, k] - c[met], u[met], v[met]) for k in range(3)], axis=1)
    lowest = at(lines[:, None], corners).min(axis=1)
    lines[:, 2] += np.maximum(-lowest, 0) * (lowest > -INSIDE)
    usable = lowest > -INSIDE
    clip, lost = keep_deepest(
        owner[usable], lines[usable], len(parts), lambda clip: _meets(start[usable], end[usable], clip)
    )
    # An edge on whose far side the triangle is ends something else: a sheet underneath, the other side of a crease.
    barred = ~usable & (lines[:, 2] > 0) & _meets(start, end, clip[owner])
    return clip, np.concatenate([owner[usable][lost], owner[barred]])


def _near(center: Array, radius: Array, edges: SharpEdges) -> tuple[Array, Array]:
    """Return pairs of splats and edges, those among them whose edge comes as near as the splat's radius."""
    length = np.linalg.norm(edges.end - edges.start, axis=1)
    pieces = np.maximum(np.ceil(length / radius.max()), 1).astype(np.intp)
    edge = np.repeat(np.arange(len(edges)), pieces)
    share = (np.arange(len(edge)) - np.repeat(np.cumsum(pieces) - pieces, pieces) + 0.5) / pieces[edge]
    tree = cKDTree(edges.start[edge] + share[:, None] * (edges.end - edges.start)[edge])
    reach = radius + 0.5 * (length / pieces).max()
    close = np.flatnonzero(tree.query(center, distance_upper_bound=reach.max())[0] <= reach)
    found = tree.query_ball_point(center[close], reach[close])
    owner = np.repeat(close, [len(f) for f in found])
    side = edge[np.array([piece for f in found for piece in f], np.intp)]
    pairs = np.unique(owner * len(edges) + side)
    return np.divmod(pairs, len(edges))


def _disc_coordinates(offset: Array, tangent_u: Array, tangent_v: Array) -> Array:
    """Return (N, 2) u and v of places relative to the discs' centers, seen along the discs' normals."""
    return np.stack([(offset * t).sum(axis=1) / (t * t).sum(axis=1) for t in (tangent_u, tangent_v)], axis=1)


def _meets(start: Array, end: Array, clip: Array) -> Array:
    """Return whether segments, (N, 2) disc coordinates, run through the inside of what lines leave of their discs."""
    step = end - start
    a, b, c = (step**2).sum(axis=1), (start * step).sum(axis=1), (start**2).sum(axis=1) - 1
    with np.errstate(divide="ignore", invalid="ignore"):
        half = np.sqrt(b * b - a * c)
        first, last = np.fmax((-b - half) / a, 0.0), np.fmin((half - b) / a, 1.0)
        for k in range(MAX_LINES):
            line = clip[:, k]
            cuts = line.any(axis=1)
            f, g = (np.where(cuts, at(line, p) - INSIDE, 1.0) for p in (start, end))
            crossing = f / (f - g)
            first = np.where(f < 0, np.where(g < 0, np.inf, np.maximum(first, crossing)), first)
            last = np.where((g < 0) & (f >= 0), np.minimum(last, crossing), last)
        met: Array = (half > 0) & ((last - first) * np.sqrt(a) > INSIDE)
    return met
