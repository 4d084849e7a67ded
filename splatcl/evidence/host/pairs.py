"""Splat-pixel pairs on the host: their fragments, and the margins of their decisions, in float64.

Margins and equations are the oracle's (splatcl/oracle). This module evaluates only the pairs that can affect a
decision, one band of rows at a time, so that scans take seconds. The result does not depend on a device.
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
from splatcl.scene.settings import FilterDepth, RenderSettings

Array = NDArray[Any]
Part = TypeVar("Part", Coverage, Hits)
MAX_MARGIN = 128.0
"""Greatest margin, in units; a decision of a pair that is not evaluated has at least this margin."""
PAIRS_PER_BAND = 1 << 20
"""Most splat-pixel pairs in memory, about 300 bytes each, 900 for ellipses."""
SLACK_PIXELS = 0.02
"""Width added around the bounds, pixels, so that near misses are pairs too."""


@dataclass(frozen=True, eq=False)
class Pairs:
    """K splat-pixel pairs of a band of rows, by pixel and then by splat: one run for each of P pixels."""

    pixel: Array  # (P,) row-major index of each pixel that has pairs, increasing
    first: Array  # (P,) first pair of the pixel's run
    splat: Array  # (K,) splat index
    run: Array  # (K,) index in `pixel` of the pair's pixel
    s: Array  # (K, 3) ray of the pair's pixel at z = 1, eye space

    def least(self, values: Array) -> Array:
        """Return the (P,) least value over each pixel's pairs."""
        return np.minimum.reduceat(values, self.first)

    def total(self, values: Array) -> Array:
        """Return the (P, ...) sum over each pixel's pairs."""
        return np.add.reduceat(values, self.first, axis=0)


@dataclass(frozen=True, eq=False)
class Fragments:
    """Fragments of K pairs by the oracle's equations; margins are signed, in units of 2^-24 times a scale."""

    disc: Hits  # (K,) the ray and the disc itself, which gives the depth
    hit: Coverage  # (K,) of the visibility pass
    drawn: Coverage  # (K,) of the attribute pass without the pre-filter "min"; `hit` itself but for EWA and points
    filter: Coverage  # (K,) of the pre-filter "min"; margin -inf without one
    center_z: Array  # (K,) eye z of the splat's center, scene units
    tolerance: Array  # (K,) epsilon along z, scene units
    strict: bool  # True: the epsilon test is z < depth(p) + epsilon
    filter_depth: FilterDepth  # depth of the fragments of the pre-filter alone
    plane_distance: Array  # (K,) signed, of the plane's z from the nearer end of [near, far], scene units
    of_ellipses: bool  # True: a ray may hit the footprint but miss the disc, and then takes the center's depth
    factor: Array  # (K,) of the weight: EWA's sqrt(|V| / |V + H|), else 1
    scale_factor: Array  # (K,) error scale of `factor`, relative


def decisions(pairs: Pairs, f: Fragments) -> tuple[Array, Array]:
    """Return the (K,) least margin of each pair's decisions, unsigned, and the (K,) distance of that decision."""
    disc, hit, drawn, filtered = (part.margin >= 0 for part in (f.disc, f.hit, f.drawn, f.filter))
    fragment_z = np.where(disc, f.disc.z, f.center_z)
    fragment_scale = np.where(disc, f.disc.scale_z, np.abs(f.center_z) + TINY)
    by_filter = filtered & ~(drawn | disc)
    if f.filter_depth == "plane":
        on_plane = by_filter & (f.disc.plane_margin >= 0)
        fragment_z = np.where(on_plane, f.disc.z, fragment_z)
        fragment_scale = np.where(on_plane, f.disc.scale_z, fragment_scale)
    z = np.where(hit, fragment_z, np.inf)
    depth = pairs.least(z)[pairs.run]
    front = pairs.least(np.where(hit & (z == depth), pairs.splat, NO_SPLAT))[pairs.run]
    is_front = front == pairs.splat
    front_scale = pairs.least(np.where(is_front, fragment_scale, np.inf))[pairs.run]
    margins, distances = (
        [np.abs(f.hit.margin)],
        [np.abs(1 - np.nan_to_num(f.hit.r))],
    )  # r of an exactly edge-on disc is 0 / 0
    at_front = by_filter & np.isfinite(depth) & (f.filter_depth == "front")
    fragment_z = np.where(at_front, depth, fragment_z)
    is_depth = is_front | at_front  # the fragment's z is depth(p) itself
    with np.errstate(invalid="ignore", over="ignore"):
        if f.filter_depth == "plane":
            margins.append(np.where(by_filter, np.abs(f.disc.plane_margin), np.inf))
            distances.append(np.abs(np.nan_to_num(f.plane_distance)))
        if f.drawn is not f.hit:
            margins.append(np.abs(f.drawn.margin))
            distances.append(np.abs(1 - np.nan_to_num(f.drawn.r)))
        if f.of_ellipses:
            margins.append(np.where(hit | drawn | filtered, np.abs(f.disc.margin), np.inf))
            distances.append(np.abs(1 - np.nan_to_num(f.disc.r)))
        gap = np.where(hit & ~is_front, z - depth, np.inf)
        margins.append(np.where(hit & ~is_front, gap / (UNIT * (fragment_scale + front_scale)), np.inf))
        distances.append(gap)
        margins.append(np.where(drawn, np.inf, np.abs(f.filter.margin)))
        distances.append(np.abs(1 - f.filter.r))
        # depth(p) itself passes unless epsilon vanishes in depth(p) + epsilon; a strict epsilon of 0 rejects it.
        slack = np.where(is_depth, f.tolerance, np.abs(depth + f.tolerance - fragment_z))
        scale = np.where(is_depth, np.abs(depth), fragment_scale + front_scale) + f.tolerance
        decided = ~is_depth | (f.strict & (f.tolerance > 0))
        tested = (drawn | filtered) & decided & np.isfinite(depth)
        margins.append(np.where(tested, slack / (UNIT * scale), np.inf))
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
    """Evaluate the oracle's equations at each pair; `offset_error` is the error of a projected center, 2^-24 pixels."""
    own = take(projected, pairs.splat)
    own = replace(own, prefilter_error=np.maximum(own.prefilter_error, offset_error))
    footprints = Footprints.of(own, camera, settings, offset_error)
    disc = intersect(footprints.discs, camera, pairs.s)
    disc = replace(disc, plane_margin=np.where(np.isnan(disc.plane_margin), -np.inf, disc.plane_margin))
    hit = drawn = _known(footprints.coverage(disc, pairs.s, filtered=False))
    nothing = np.zeros(len(pairs.splat))
    factor, scale_factor = nothing + 1, nothing
    if settings.prefilter == "ewa" or settings.sprite == "point":
        drawn = _known(footprints.coverage(disc, pairs.s, filtered=True))
    if settings.prefilter == "ewa":
        assert footprints.ellipses
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
        strict=settings.epsilon_test == "strict",
        filter_depth=settings.filter_depth,
        plane_distance=np.minimum(disc.z - camera.near, camera.far - disc.z),
        of_ellipses=footprints.ellipses is not None,
        factor=factor,
        scale_factor=scale_factor,
    )


def _known(part: Part) -> Part:
    """Return `part` with -inf for undefined margins: such a fragment surely does not exist."""
    return replace(part, margin=np.where(np.isnan(part.margin), -np.inf, part.margin))


def bands(projected: ProjectedSplats, camera: Camera, settings: RenderSettings) -> Iterator[Pairs]:
    """Yield the pairs of consecutive bands of rows: each splat with the pixels of its widened bounds."""
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
    """Return the pairs of each splat with the pixels of its rectangle; the last column and row are included."""
    width = x_last - x_first + 1
    counts = width * (y_last - y_first + 1)
    which = np.repeat(np.arange(len(splat)), counts)
    nth = np.arange(len(which)) - np.repeat(np.cumsum(counts) - counts, counts)
    x, y = x_first[which] + nth % width[which], y_first[which] + nth // width[which]
    pixel = y * camera.width + x
    order = np.argsort(pixel, kind="stable")
    pixels, first, run = np.unique(pixel[order], return_index=True, return_inverse=True)
    s = np.stack([(x + 0.5 - camera.cx) / camera.fx, (y + 0.5 - camera.cy) / camera.fy, np.ones(len(x))], axis=1)
    return Pairs(pixels, first, splat[which][order], run, s[order])


def _wide_bounds(projected: ProjectedSplats, camera: Camera, settings: RenderSettings) -> NDArray[np.int64]:
    """Return (N, 4) x_first y_first x_last y_last of the pixels that each splat touches or nearly touches."""
    p, radius = projected, settings.prefilter_radius
    square = np.hstack([p.prefilter_point - radius, p.prefilter_point + radius])
    square[~(p.prefilter_margin > -MAX_MARGIN)] = NOTHING
    covered, slack = (
        _disc_bounds(p, camera) if settings.footprint == "raycast" else _ellipse_bounds(p, camera, settings)
    )
    slack = SLACK_PIXELS + slack
    low = np.minimum(covered, square)[:, :2] - 0.5 - slack
    high = np.maximum(covered, square)[:, 2:] - 0.5 + slack
    surely_culled = p.culled & (np.abs(p.facing_margin) > MAX_MARGIN)
    low[surely_culled], high[surely_culled] = np.inf, -np.inf
    last = np.array([camera.width - 1, camera.height - 1])
    first_pixel = np.ceil(np.clip(low, 0, last + 1)).astype(np.int64)
    last_pixel = np.floor(np.clip(high, -1, last)).astype(np.int64)
    return np.hstack([first_pixel, last_pixel])


def _disc_bounds(p: ProjectedSplats, camera: Camera) -> tuple[Array, Array]:
    """Return the (N, 4) bounds of the discs, and the (N, 1) most that rounding can extend them by, pixels."""
    disc = disc_bounds(p.center_eye, p.tangent_u_eye, p.tangent_v_eye, camera)
    disc[out_of_range(p, camera)] = NOTHING
    kappa = Discs.of(p, camera).kappa
    with np.errstate(invalid="ignore"):
        size = (disc[:, 2:] - disc[:, :2]).max(axis=1, initial=0.0)
        slack = np.nan_to_num(size * np.minimum(100.0, MAX_MARGIN * UNIT * (8 + 4 * kappa)), nan=0.0)
    return disc, slack[:, None]


def _ellipse_bounds(p: ProjectedSplats, camera: Camera, settings: RenderSettings) -> tuple[Array, Array]:
    """Return the (N, 4) bounds of the ellipses, filtered or not, and the (N, 2) most that rounding can extend them by.

    The limit of the extension is the circle around the ellipse. In pixels, across and down.
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
    """Return the splats `ids`."""
    return ProjectedSplats(**{field.name: getattr(projected, field.name)[ids] for field in fields(projected)})
