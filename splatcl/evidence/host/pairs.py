"""How near each pixel's decisions are to flipping, and what the envelope needs to know of each splat-pixel pair.

The margin is the oracle's (splatcl/oracle), and so are the equations; here only the splat-pixel pairs that can
matter are evaluated, a band of rows at a time, so that real scans take seconds. All in float64, on the host: the
result does not depend on the device.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from splatcl.oracle.buffers import NO_SPLAT, NOTHING, ProjectedSplats
from splatcl.oracle.geometry.discs import Discs, Hits, disc_bounds, intersect, out_of_range
from splatcl.oracle.geometry.ellipse_maps import EllipseMaps
from splatcl.oracle.geometry.ellipses import Coverage
from splatcl.oracle.geometry.fragments import Footprints
from splatcl.oracle.geometry.rays import OFFSET_ERROR, TINY, UNIT, ray_length
from splatcl.scene.camera import Camera
from splatcl.scene.settings import RenderSettings

Array = NDArray[Any]
Part = TypeVar("Part", Coverage, Hits)
MAX_MARGIN = 128.0
"""Margins are given up to this many units; what could flip beyond lies outside the pairs evaluated."""
PAIRS_PER_BAND = 1 << 20
"""Splat-pixel pairs held in memory together (about 300 bytes each, 900 of ellipses)."""
SLACK_PIXELS = 0.02
"""Added around the bounds, so that a near miss is a pair as well."""


@dataclass(frozen=True, eq=False)
class Pairs:
    """K splat-pixel pairs of a band of rows, by pixel and then by splat; `first` starts each pixel's run."""

    pixel: Array  # (P,) index of each pixel that has pairs, increasing
    first: Array  # (P,) its first pair
    splat: Array  # (K,)
    run: Array  # (K,) index in `pixel` of the pair's pixel
    s: Array  # (K, 3) the pixels' rays at z = 1

    def least(self, values: Array) -> Array:
        """(P,) least value over each pixel's pairs."""
        return np.minimum.reduceat(values, self.first)

    def total(self, values: Array) -> Array:
        """(P, ...) sum over each pixel's pairs."""
        return np.add.reduceat(values, self.first, axis=0)


@dataclass(frozen=True, eq=False)
class Fragments:
    """What the oracle's equations say of each pair, (K,) each; margins are signed, in units of 2^-24."""

    disc: Hits  # of the disc itself, which gives the depth
    hit: Coverage  # of the visibility pass
    drawn: Coverage  # of the attribute pass, without the pre-filter "min"; `hit` but for EWA
    filter: Coverage  # of the pre-filter "min"; margin -inf for none
    center_z: Array
    tolerance: Array  # epsilon along z
    of_ellipses: bool  # a hit's ray may miss the disc; it takes the centre's depth then
    factor: Array  # of the weight
    scale_factor: Array  # relative


def decisions(pairs: Pairs, f: Fragments) -> tuple[Array, Array]:
    """(K,) least margin, unsigned, of each pair's decisions, and the (K,) distance it stands for."""
    disc, hit, drawn, filtered = (part.margin >= 0 for part in (f.disc, f.hit, f.drawn, f.filter))
    fragment_z = np.where(disc, f.disc.z, f.center_z)
    fragment_scale = np.where(disc, f.disc.scale_z, np.abs(f.center_z) + TINY)
    z = np.where(hit, fragment_z, np.inf)
    depth = pairs.least(z)[pairs.run]
    front = pairs.least(np.where(hit & (z == depth), pairs.splat, NO_SPLAT))[pairs.run]
    is_front = front == pairs.splat
    front_scale = pairs.least(np.where(is_front, fragment_scale, np.inf))[pairs.run]
    margins, distances = [np.abs(f.hit.margin)], [np.abs(1 - np.nan_to_num(f.hit.r))]  # exactly edge-on: r is 0 / 0
    with np.errstate(invalid="ignore", over="ignore"):
        if f.of_ellipses:
            margins.append(np.abs(f.drawn.margin))
            distances.append(np.abs(1 - np.nan_to_num(f.drawn.r)))
            margins.append(np.where(hit | drawn | filtered, np.abs(f.disc.margin), np.inf))
            distances.append(np.abs(1 - np.nan_to_num(f.disc.r)))
        gap = np.where(hit & ~is_front, z - depth, np.inf)
        margins.append(np.where(hit & ~is_front, gap / (UNIT * (fragment_scale + front_scale)), np.inf))
        distances.append(gap)
        margins.append(np.where(drawn, np.inf, np.abs(f.filter.margin)))
        distances.append(np.abs(1 - f.filter.r))
        slack = np.abs(depth + f.tolerance - fragment_z)
        tested = (drawn | filtered) & ~is_front & np.isfinite(depth)
        margins.append(np.where(tested, slack / (UNIT * (fragment_scale + front_scale + f.tolerance)), np.inf))
        distances.append(slack)
    stacked = np.stack(margins)
    least = stacked.argmin(axis=0)
    columns = np.arange(len(least))
    return stacked[least, columns], np.stack(distances)[least, columns]


def fragments(
    pairs: Pairs,
    projected: ProjectedSplats,
    camera: Camera,
    settings: RenderSettings,
    epsilon: float,
    offset_error: float = OFFSET_ERROR,
) -> Fragments:
    """Evaluate the oracle's equations at each pair; `offset_error` is that of a projected centre, 2^-24 pixels."""
    own = take(projected, pairs.splat)
    own = replace(own, prefilter_error=np.maximum(own.prefilter_error, offset_error))
    footprints = Footprints.of(own, camera, settings, offset_error)
    disc = intersect(footprints.discs, camera, pairs.s)
    hit = drawn = _known(footprints.coverage(disc, pairs.s, filtered=False))
    nothing = np.zeros(len(pairs.splat))
    factor, scale_factor = nothing + 1, nothing
    if settings.prefilter == "ewa":
        assert footprints.ellipses
        drawn = _known(footprints.coverage(disc, pairs.s, filtered=True))
        maps = footprints.ellipses.maps
        factor, scale_factor = np.nan_to_num(maps.factor), 8 * (1 + footprints.discs.kappa + 1 / maps.rest)
    absent = Coverage(nothing + np.inf, nothing, nothing, nothing - np.inf)
    tolerance = np.full(len(pairs.splat), epsilon)
    if settings.along == "ray":
        tolerance /= ray_length(camera, pairs.s)
    return Fragments(
        disc=_known(disc),
        hit=hit,
        drawn=drawn,
        filter=_known(footprints.prefilter(disc, pairs.s)) if settings.prefilter == "min" else absent,
        center_z=own.center_eye[:, 2],
        tolerance=tolerance,
        of_ellipses=footprints.ellipses is not None,
        factor=factor,
        scale_factor=scale_factor,
    )


def _known(part: Part) -> Part:
    """Return it with what is undefined as surely not there."""
    return replace(part, margin=np.where(np.isnan(part.margin), -np.inf, part.margin))


def bands(projected: ProjectedSplats, camera: Camera, settings: RenderSettings) -> Iterator[Pairs]:
    """Yield the pairs of consecutive bands of rows: each splat with the pixels in its widened bounds."""
    bounds = _wide_bounds(projected, camera, settings)
    x_first, x_last = bounds[:, 0], bounds[:, 2]
    y_first, y_last = bounds[:, 1], bounds[:, 3]
    used = np.flatnonzero((x_first <= x_last) & (y_first <= y_last))
    x_first, x_last, y_first, y_last = (b[used] for b in (x_first, x_last, y_first, y_last))
    steps = np.zeros(camera.height + 1, np.int64)
    np.add.at(steps, y_first, x_last - x_first + 1)
    np.subtract.at(steps, y_last + 1, x_last - x_first + 1)
    ends = np.cumsum(np.cumsum(steps)[:-1])
    row = 0
    while row < camera.height:
        done = ends[row - 1] if row else 0
        end = max(int(np.searchsorted(ends, done + PAIRS_PER_BAND, side="right")), row + 1)
        inside = (y_first < end) & (y_last >= row)
        if inside.any():
            top, bottom = np.maximum(y_first[inside], row), np.minimum(y_last[inside], end - 1)
            yield _expand(used[inside], x_first[inside], x_last[inside], top, bottom, camera)
        row = end


def _expand(splat: Array, x_first: Array, x_last: Array, y_first: Array, y_last: Array, camera: Camera) -> Pairs:
    """Write out each splat's pixel rectangle as pairs."""
    width = x_last - x_first + 1
    counts = width * (y_last - y_first + 1)
    which = np.repeat(np.arange(len(splat)), counts)
    place = np.arange(len(which)) - np.repeat(np.cumsum(counts) - counts, counts)
    x, y = x_first[which] + place % width[which], y_first[which] + place // width[which]
    pixel = y * camera.width + x
    order = np.argsort(pixel, kind="stable")
    pixels, first, run = np.unique(pixel[order], return_index=True, return_inverse=True)
    s = np.stack([(x + 0.5 - camera.cx) / camera.fx, (y + 0.5 - camera.cy) / camera.fy, np.ones(len(x))], axis=1)
    return Pairs(pixels, first, splat[which][order], run, s[order])


def _wide_bounds(projected: ProjectedSplats, camera: Camera, settings: RenderSettings) -> NDArray[np.int64]:
    """(N, 4) first x, first y, last x, last y of the pixels a splat touches or nearly touches, in the image."""
    p, radius = projected, settings.prefilter_radius
    square = np.hstack([p.prefilter_point - radius, p.prefilter_point + radius])
    square[~(p.prefilter_margin > -MAX_MARGIN)] = NOTHING
    covered, slack = (
        _disc_bounds(p, camera) if settings.footprint == "raycast" else _ellipse_bounds(p, camera, settings)
    )
    slack = SLACK_PIXELS + slack
    low = np.minimum(covered, square)[:, :2] - 0.5 - slack
    high = np.maximum(covered, square)[:, 2:] - 0.5 + slack
    hopeless = p.culled & (np.abs(p.facing_margin) > MAX_MARGIN)
    low[hopeless], high[hopeless] = np.inf, -np.inf
    last = np.array([camera.width - 1, camera.height - 1])
    first_pixel = np.ceil(np.clip(low, 0, last + 1)).astype(np.int64)
    last_pixel = np.floor(np.clip(high, -1, last)).astype(np.int64)
    return np.hstack([first_pixel, last_pixel])


def _disc_bounds(p: ProjectedSplats, camera: Camera) -> tuple[Array, Array]:
    """(N, 4) bounds of the discs; (N, 1) how far beyond, at most, rounding may let them be hit. Pixels."""
    disc = disc_bounds(p.center_eye, p.tangent_u_eye, p.tangent_v_eye, camera)
    disc[out_of_range(p, camera)] = NOTHING
    kappa = Discs.of(p, camera).kappa
    with np.errstate(invalid="ignore"):
        size = (disc[:, 2:] - disc[:, :2]).max(axis=1, initial=0.0)
        slack = np.nan_to_num(size * np.minimum(100.0, MAX_MARGIN * UNIT * (8 + 4 * kappa)), nan=0.0)
    return disc, slack[:, None]


def _ellipse_bounds(p: ProjectedSplats, camera: Camera, settings: RenderSettings) -> tuple[Array, Array]:
    """(N, 4) bounds of the ellipses, filtered or not; (N, 2) how far beyond, across and down, as `_disc_bounds`.

    That is not beyond the circles of their long axes.
    """
    maps = EllipseMaps.of(p.center_eye, p.tangent_u_eye, p.tangent_v_eye, camera, settings)
    kappa, unit = Discs.of(p, camera).kappa, MAX_MARGIN * UNIT
    bounds = maps.bounds(maps.margin > -MAX_MARGIN)
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        half = (bounds[:, 2:] - bounds[:, :2]) / 2
        circle = np.hypot(*half.T)
        slack = (circle + 4) * unit * (8 + 16 * kappa / maps.rest)
        slack = np.fmin(slack[:, None], (circle * (1 + 8 * unit))[:, None] - half)
    return bounds, np.nan_to_num(slack, nan=0.0)


def take(projected: ProjectedSplats, ids: Array) -> ProjectedSplats:
    """Return the rows `ids` of every field."""
    return ProjectedSplats(**{field.name: getattr(projected, field.name)[ids] for field in fields(projected)})
