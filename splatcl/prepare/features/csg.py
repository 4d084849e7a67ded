"""Splats of solids: discs that cover each surface, cut off where another surface ends the solid."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from splatcl.errors import SettingsError
from splatcl.prepare.features.clip_lines import at, clip_lines, cut_depth, keep_deepest, lost_note, plane_lines
from splatcl.prepare.features.solids import Discs, Solid, Surface, box
from splatcl.scene.splats import DEFAULT_COLOR, MAX_MAGNITUDE, Splats

Array = NDArray[Any]
Piece = tuple[bool, dict[int, bool]]
"""A part of a disc: whether its normal is the surface's own, and on which side of other surfaces it is."""
STEPS = 6
"""Newton steps from a disc's center to where another surface crosses its plane."""
CROSSING = 0.05
"""A surface crosses a disc's plane if these steps end nearer to it than this, in disc coordinates."""
MAX_CROSSING = 4
"""Surfaces, the nearest ones, that a disc is cut off at."""


def cube(center: ArrayLike = (0.0, 0.0, 0.0), size: float = 1.0, color: ArrayLike = DEFAULT_COLOR) -> Splats:
    """Return a cube of 24 splats, four for each face, each cut off along the two edges of its corner.

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
        float64; four after another are of one face, in the order -x, x, -y, y, -z, z.

    Raises
    ------
    SettingsError
        Not three finite numbers, or a size that is not positive.
    """
    surfaces = box(center, (size, size, size), color).surfaces
    splats = _joined([_whole(surface, surface.discs(size / 2)) for surface in surfaces])
    # Across an edge, the nearest splat is half as far as the one beside it.
    pairs = cKDTree(splats.center).query_pairs(0.4 * size, output_type="ndarray")
    return clip_lines(splats, pairs)


def csg_splats(solid: Solid, spacing: float) -> Splats:
    """Return splats that cover the surface of a solid and end at its edges.

    Each surface of the solid is covered by discs. A disc that other surfaces cross is cut off there along straight
    lines: the tangent of the crossing curve where the part inside is kept, and where the part outside is kept the
    line through the curve's ends on the disc, so that no gap opens. A part is kept where it bounds the solid. A disc
    of which no part is kept is left out; one whose kept part is not convex becomes two or more splats that overlap.

    Parameters
    ----------
    solid : Solid
        Made by `box`, `sphere` and `cylinder`, and ``|``, ``&`` and ``-``. No two of its surfaces may coincide.
    spacing : float
        Largest distance of neighboring centers on a surface, scene units; well below the radii of the curved
        surfaces.

    Returns
    -------
    Splats
        float64, surface by surface. The notes count splats that were cut off and lines that could not be kept.

    Raises
    ------
    SettingsError
        `spacing` is not positive.
    """
    if not 0 < spacing < MAX_MAGNITUDE:
        raise SettingsError(f"spacing must be positive and finite, not {spacing}")
    parts, counts = zip(*(_of_surface(solid, which, spacing) for which in range(len(solid.surfaces))), strict=True)
    splats = _joined(list(parts))
    cut = 0 if splats.clip is None else np.count_nonzero(splats.clip.any(axis=(1, 2)))
    notes = [f"covered {len(parts)} surfaces by {len(splats)} splats, {cut} of them cut off at others"]
    num_lost, num_crowded = np.sum(counts, axis=0)
    notes += lost_note(num_lost)
    notes += [f"{num_crowded} discs are crossed by more than {MAX_CROSSING} surfaces"] if num_crowded else []
    return replace(splats, notes=tuple(notes), on_invalid="error")


def _whole(surface: Surface, discs: Discs) -> Splats:
    return Splats(*discs, np.tile(surface.color.astype(np.float32), (len(discs[0]), 1)))


def _joined(parts: list[Splats]) -> Splats:
    center, tangent_u, tangent_v, color = (
        np.concatenate([getattr(part, name) for part in parts])
        for name in ("center", "tangent_u", "tangent_v", "color")
    )
    clips = [part.clip for part in parts if part.clip is not None]
    return Splats(center, tangent_u, tangent_v, color, clip=np.concatenate(clips) if clips else None)


def _of_surface(solid: Solid, which: int, spacing: float) -> tuple[Splats, tuple[int, int]]:
    """Return the splats of one surface, and the numbers of lines not kept and of discs that too many surfaces cross."""
    surface = solid.surfaces[which]
    center, tangent_u, tangent_v = discs = surface.discs(spacing)
    inside, lines, sag = _surroundings(solid, which, discs)
    crosses = np.asarray(lines.any(axis=2))
    crowded = np.flatnonzero(crosses.sum(axis=0) > MAX_CROSSING)
    apart = np.where(crosses, np.abs(lines[..., 2]), np.inf)[:, crowded]
    crosses[:, crowded] &= np.argsort(np.argsort(apart, axis=0), axis=0) < MAX_CROSSING

    source, owner = [np.empty(0, np.intp)], [np.empty(0, np.intp)]
    turned, chosen, num = [np.empty(0, bool)], [np.empty((0, 3))], 0
    for ids in _alike(np.concatenate([inside, crosses])):
        for as_is, sides in _pieces(solid, which, inside[:, ids[0]], crosses[:, ids[0]]):
            source.append(ids)
            turned.append(np.full(len(ids), not as_is))
            for k, within in sides.items():
                owner.append(num + np.arange(len(ids)))
                chosen.append(-lines[k, ids] if within else lines[k, ids] + sag[k, ids, None] * (0, 0, 1))
            num += len(ids)
    part, flip = np.concatenate(source), np.concatenate(turned)
    clip, lost = keep_deepest(np.concatenate(owner), np.concatenate(chosen), num)
    left = np.flatnonzero(np.isfinite(cut_depth(np.zeros((num, 3)), clip)))
    left = left[np.argsort(part[left], kind="stable")]
    part, clip, sign = part[left], clip[left], np.where(flip[left], -1.0, 1.0)[:, None]
    clip[:, :, 1] *= sign
    splats = _whole(surface, (center[part], tangent_u[part], sign * tangent_v[part]))
    return replace(splats, clip=clip, on_invalid="error"), (int(np.count_nonzero(lost)), len(crowded))


def _surroundings(solid: Solid, which: int, discs: Discs) -> tuple[Array, Array, Array]:
    """Return (S, N) whether centers are inside of each surface, and (S, N, 3) `lines` and (S, N) `sag` of `_crossing`.

    A disc's own surface crosses it nowhere.
    """
    center, tangent_u, tangent_v = discs
    radius = np.maximum(np.linalg.norm(tangent_u, axis=1), np.linalg.norm(tangent_v, axis=1))
    distance = np.stack([other.nearest(center)[0] for other in solid.surfaces])
    near = np.abs(distance) <= radius
    near[which] = False
    lines, sag = np.zeros((*distance.shape, 3)), np.zeros(distance.shape)
    for k in np.flatnonzero(near.any(axis=1)):
        ids = np.flatnonzero(near[k])
        lines[k, ids], sag[k, ids] = _crossing(solid.surfaces[k], (center[ids], tangent_u[ids], tangent_v[ids]))
    return distance <= 0, lines, sag


def _alike(flags: Array) -> list[Array]:
    """Return the indices of each group of equal columns of (F, N) bools."""
    kind = np.zeros(flags.shape[1], np.intp)
    for row in flags:
        kind = np.unique(2 * kind + row, return_inverse=True)[1]
    order = np.argsort(kind, kind="stable")
    return [ids for ids in np.split(order, np.flatnonzero(np.diff(kind[order])) + 1) if len(ids)]


def _crossing(other: Surface, discs: Discs) -> tuple[Array, Array]:
    """Return where a surface crosses discs.

    Returns
    -------
    lines : (N, 3) float64 array
        Tangents of the crossing curves, which keep what is outside of the surface; zeros where there is none.
    sag : (N,) float64 array
        How far the curve is behind its tangent where it leaves the disc: a part outside that is cut off along
        the tangent, c without this, does not reach the curve there.
    """
    center, tangent_u, tangent_v = discs

    def tangents(points: Array) -> Array:
        place = center + points[:, :1] * tangent_u + points[:, 1:] * tangent_v
        distance, normal = other.nearest(place)
        return plane_lines(center, tangent_u, tangent_v, place - distance[:, None] * normal, normal)

    foot = np.zeros((len(center), 2))
    for _ in range(STEPS):
        lines = tangents(foot)
        foot = -lines[:, 2:] * lines[:, :2]
    met = lines.any(axis=1) & (np.abs(lines[:, 2]) < 1) & (np.abs(at(tangents(foot), foot)) <= CROSSING)
    half = np.sqrt(np.where(met, 1 - lines[:, 2] ** 2, 0.0))[:, None]
    along = half * np.stack([-lines[:, 1], lines[:, 0]], axis=1)
    sag = np.max([at(tangents(foot + step), foot + step) for step in (-along, along)], axis=0)
    return np.where(met[:, None], lines, 0.0), np.where(met, np.clip(sag, 0.0, 1.0), 0.0)


def _pieces(solid: Solid, which: int, inside: Array, crosses: Array) -> list[Piece]:
    """Return the largest parts of a disc on one surface that bound the solid.

    Parameters
    ----------
    which : int
        The disc's surface.
    inside, crosses : (S,) bool array
        Whether the disc's center is inside of each surface, and whether the surface crosses the disc.
    """
    others = [int(k) for k in np.flatnonzero(crosses)]

    def bounds(sides: tuple[bool, ...], as_is: bool) -> bool:
        flags = [bool(flag) for flag in inside]
        for other, side in zip(others, sides, strict=True):
            flags[other] = side
        behind, before = ([*flags[:which], own, *flags[which + 1 :]] for own in (as_is, not as_is))
        return bool(solid.contains(behind)) and not solid.contains(before)

    pieces: list[Piece] = []
    for as_is in (True, False):
        # None: on either side. All choices that hold throughout, then those that are in no larger one.
        whole = [
            choice
            for choice in product((None, False, True), repeat=len(others))
            if all(bounds(sides, as_is) for sides in product(*((False, True) if s is None else (s,) for s in choice)))
        ]
        for choice in whole:
            larger = (c for c in whole if c != choice)
            if not any(all(a is None or a == b for a, b in zip(c, choice, strict=True)) for c in larger):
                pieces.append((as_is, {k: side for k, side in zip(others, choice, strict=True) if side is not None}))
    return pieces
