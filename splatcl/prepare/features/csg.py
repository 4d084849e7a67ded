"""Splats of solids: discs cover each surface, and clip lines end them at the solid's edges ([ZRB04] section 5)."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from splatcl.errors import SettingsError
from splatcl.prepare.features.clip_lines import clip_lines, cut_depth, evaluate, keep_deepest, lost_note, plane_lines
from splatcl.prepare.features.solids import Discs, Solid, Surface, box
from splatcl.scene.splats import DEFAULT_COLOR, MAX_MAGNITUDE, Splats

Array = NDArray[Any]
Piece = tuple[bool, dict[int, bool]]
"""A part of a disc: whether it keeps the surface's normal, and whether it is inside of each crossing surface."""
STEPS = 6
"""Number of Newton steps from a disc's center to the crossing of another surface with its plane."""
CROSSING = 0.05
"""Largest remaining distance after these steps, disc coordinates, for a surface that crosses a disc's plane."""
MAX_CROSSING = 4
"""Largest number of surfaces that a disc is cut off at: the nearest ones."""


def cube(center: ArrayLike = (0.0, 0.0, 0.0), size: float = 1.0, color: ArrayLike = DEFAULT_COLOR) -> Splats:
    """Make a cube of 24 splats, four for each face; each is cut off along the two edges of its corner.

    Parameters
    ----------
    center : (3,) float
        World space.
    size : float
        Length of an edge, scene units.
    color : (3,) float
        Linear RGB.

    Returns
    -------
    Splats
        float64; four consecutive splats for each face, in the order -x, x, -y, y, -z, z.

    Raises
    ------
    SettingsError
        `center` or `color` is not three finite numbers, or `size` is not positive.
    """
    surfaces = box(center, (size, size, size), color).surfaces
    splats = _concatenated([_unclipped(surface, surface.discs(size / 2)) for surface in surfaces])
    # The distance is 0.35 size to the neighbor across an edge and 0.5 size to one on the same face.
    pairs = cKDTree(splats.center).query_pairs(0.4 * size, output_type="ndarray")
    return clip_lines(splats, pairs)


def csg_splats(solid: Solid, spacing: float) -> Splats:
    """Make splats that cover the surface of a solid and end at its edges.

    Discs cover each surface of the solid. Other surfaces divide a disc into parts; a part is kept if it bounds the
    solid. A disc without a kept part is dropped. A disc whose kept part is not convex becomes several splats, which
    overlap.

    Straight lines replace the curves in which surfaces cross a disc. A part inside of the other surface ends at the
    curve's tangent. A part outside ends at the line through the curve's ends on the disc, so that no gap opens.

    Parameters
    ----------
    solid : Solid
        A combination of `box`, `sphere` and `cylinder` by ``|``, ``&`` and ``-``; no two of its surfaces coincide.
    spacing : float
        Largest distance between neighboring centers on a surface, scene units; well below the radii of curved
        surfaces.

    Returns
    -------
    Splats
        float64, surface by surface. The notes count cut splats and dropped lines.

    Raises
    ------
    SettingsError
        `spacing` is not positive.
    """
    if not 0 < spacing < MAX_MAGNITUDE:
        raise SettingsError(f"spacing must be positive and finite, not {spacing}")
    parts, counts = zip(*(_surface_splats(solid, k, spacing) for k in range(len(solid.surfaces))), strict=True)
    splats = _concatenated(list(parts))
    cut = 0 if splats.clip is None else np.count_nonzero(splats.clip.any(axis=(1, 2)))
    notes = [f"covered {len(parts)} surfaces with {len(splats)} splats, {cut} of them cut off at other surfaces"]
    num_lost, num_crowded = np.sum(counts, axis=0)
    notes += lost_note(num_lost)
    notes += [f"more than {MAX_CROSSING} surfaces cross {num_crowded} discs"] if num_crowded else []
    return replace(splats, notes=tuple(notes), on_invalid="error")


def _unclipped(surface: Surface, discs: Discs) -> Splats:
    return Splats(*discs, np.tile(surface.color.astype(np.float32), (len(discs[0]), 1)))


def _concatenated(parts: list[Splats]) -> Splats:
    center, tangent_u, tangent_v, color = (
        np.concatenate([getattr(part, name) for part in parts])
        for name in ("center", "tangent_u", "tangent_v", "color")
    )
    clips = [part.clip for part in parts if part.clip is not None]
    return Splats(center, tangent_u, tangent_v, color, clip=np.concatenate(clips) if clips else None)


def _surface_splats(solid: Solid, index: int, spacing: float) -> tuple[Splats, tuple[int, int]]:
    """Make the splats of the surface `index`; count lost lines and discs that too many surfaces cross."""
    surface = solid.surfaces[index]
    center, tangent_u, tangent_v = discs = surface.discs(spacing)
    inside, lines, sag = _crossings(solid, index, discs)
    crosses = np.asarray(lines.any(axis=2))
    crowded = np.flatnonzero(crosses.sum(axis=0) > MAX_CROSSING)
    distance = np.where(crosses, np.abs(lines[..., 2]), np.inf)[:, crowded]
    crosses[:, crowded] &= np.argsort(np.argsort(distance, axis=0), axis=0) < MAX_CROSSING

    # Discs with the same flags have the same pieces.
    source, owner = [np.empty(0, np.intp)], [np.empty(0, np.intp)]
    turned, chosen, num = [np.empty(0, bool)], [np.empty((0, 3))], 0
    for ids in _equal_columns(np.concatenate([inside, crosses])):
        for same_normal, sides in _pieces(solid, index, inside[:, ids[0]], crosses[:, ids[0]]):
            source.append(ids)
            turned.append(np.full(len(ids), not same_normal))
            for k, is_inside in sides.items():
                owner.append(num + np.arange(len(ids)))
                chosen.append(-lines[k, ids] if is_inside else lines[k, ids] + sag[k, ids, None] * (0, 0, 1))
            num += len(ids)
    disc, flip = np.concatenate(source), np.concatenate(turned)
    clip, lost = keep_deepest(np.concatenate(owner), np.concatenate(chosen), num)
    kept = np.flatnonzero(np.isfinite(cut_depth(np.zeros((num, 3)), clip)))
    kept = kept[np.argsort(disc[kept], kind="stable")]
    disc, clip, sign = disc[kept], clip[kept], np.where(flip[kept], -1.0, 1.0)[:, None]
    clip[:, :, 1] *= sign  # the lines follow the turned tangent v
    splats = _unclipped(surface, (center[disc], tangent_u[disc], sign * tangent_v[disc]))
    return replace(splats, clip=clip, on_invalid="error"), (int(np.count_nonzero(lost)), len(crowded))


def _crossings(solid: Solid, index: int, discs: Discs) -> tuple[Array, Array, Array]:
    """Find the crossings of all surfaces with the discs of the surface `index`.

    Returns
    -------
    inside : (S, N) bool array
        Whether each center is inside of each surface.
    lines, sag : (S, N, 3) and (S, N) float64 arrays
        As `_crossing` returns them; zeros for the disc's own surface.
    """
    center, tangent_u, tangent_v = discs
    radius = np.maximum(np.linalg.norm(tangent_u, axis=1), np.linalg.norm(tangent_v, axis=1))
    distance = np.stack([other.nearest(center)[0] for other in solid.surfaces])
    near = np.abs(distance) <= radius
    near[index] = False
    lines, sag = np.zeros((*distance.shape, 3)), np.zeros(distance.shape)
    for k in np.flatnonzero(near.any(axis=1)):
        ids = np.flatnonzero(near[k])
        lines[k, ids], sag[k, ids] = _crossing(solid.surfaces[k], (center[ids], tangent_u[ids], tangent_v[ids]))
    return distance <= 0, lines, sag


def _equal_columns(flags: Array) -> list[Array]:
    """Group equal columns of (F, N) bools; return the column indices of each group."""
    group = np.zeros(flags.shape[1], np.intp)
    for row in flags:
        group = np.unique(2 * group + row, return_inverse=True)[1]
    order = np.argsort(group, kind="stable")
    return [ids for ids in np.split(order, np.flatnonzero(np.diff(group[order])) + 1) if len(ids)]


def _crossing(other: Surface, discs: Discs) -> tuple[Array, Array]:
    """Find the curves in which a surface crosses discs.

    Returns
    -------
    lines : (N, 3) float64 array
        Tangents of the curves, which keep the outside of the surface, disc coordinates; zeros without a crossing.
    sag : (N,) float64 array
        Distance of the curve's ends on the disc behind the tangent, disc coordinates. A part outside must extend
        this far behind the tangent to reach the curve.
    """
    center, tangent_u, tangent_v = discs

    def tangents(uv: Array) -> Array:
        points = center + uv[:, :1] * tangent_u + uv[:, 1:] * tangent_v
        distance, normal = other.nearest(points)
        return plane_lines(center, tangent_u, tangent_v, points - distance[:, None] * normal, normal)

    foot = np.zeros((len(center), 2))
    for _ in range(STEPS):
        lines = tangents(foot)
        foot = -lines[:, 2:] * lines[:, :2]
    crosses = lines.any(axis=1) & (np.abs(lines[:, 2]) < 1) & (np.abs(evaluate(tangents(foot), foot)) <= CROSSING)
    half = np.sqrt(np.where(crosses, 1 - lines[:, 2] ** 2, 0.0))[:, None]
    along = half * np.stack([-lines[:, 1], lines[:, 0]], axis=1)
    sag = np.max([evaluate(tangents(foot + step), foot + step) for step in (-along, along)], axis=0)
    return np.where(crosses[:, None], lines, 0.0), np.where(crosses, np.clip(sag, 0.0, 1.0), 0.0)


def _pieces(solid: Solid, index: int, inside: Array, crosses: Array) -> list[Piece]:
    """Return the largest parts of a disc that bound the solid.

    Parameters
    ----------
    index : int
        The disc's surface.
    inside, crosses : (S,) bool array
        Whether the disc's center is inside of each surface, and whether the surface crosses the disc.
    """
    others = [int(k) for k in np.flatnonzero(crosses)]

    def bounds(sides: tuple[bool, ...], same_normal: bool) -> bool:
        """Return whether the part on these sides has the solid behind it and none in front."""
        flags = [bool(flag) for flag in inside]
        for other, side in zip(others, sides, strict=True):
            flags[other] = side
        behind, in_front = ([*flags[:index], own, *flags[index + 1 :]] for own in (same_normal, not same_normal))
        return bool(solid.contains(behind)) and not solid.contains(in_front)

    pieces: list[Piece] = []
    for same_normal in (True, False):
        # A choice gives the side of each crossing surface; None stands for both sides.
        bounding = [
            choice
            for choice in product((None, False, True), repeat=len(others))
            if all(
                bounds(sides, same_normal)
                for sides in product(*((False, True) if side is None else (side,) for side in choice))
            )
        ]
        for choice in bounding:
            larger = (c for c in bounding if c != choice)
            if not any(all(a is None or a == b for a, b in zip(c, choice, strict=True)) for c in larger):
                sides = {k: side for k, side in zip(others, choice, strict=True) if side is not None}
                pieces.append((same_normal, sides))
    return pieces
