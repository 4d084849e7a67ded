"""How near each pixel's decisions are to flipping, and between what bounds any correct renderer must land.

The margin is the oracle's (splatcl/oracle.py), and so are the equations; here only the splat-pixel pairs that can
matter are evaluated, a band of rows at a time, so that real scans take seconds. All in float64, on the host: the
result does not depend on the device.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splatcl import oracle
from splatcl.camera import Camera
from splatcl.oracle import NO_SPLAT, UNIT
from splatcl.settings import RenderSettings
from splatcl.splats import Splats

Array = NDArray[Any]
MAX_MARGIN = 128.0
"""Margins are given up to this many units; what could flip beyond lies outside the pairs evaluated."""
PAIRS_PER_BAND = 1 << 20
"""Splat-pixel pairs held in memory together (about 300 bytes each)."""
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

    hit_margin: Array  # of r3 <= 1 and all else that a hit needs
    hit_z: Array
    scale_z: Array  # of hit_z
    r3: Array
    scale_r3: Array
    filter_margin: Array  # of r2 <= 1 and all else that the pre-filter needs
    r2: Array
    scale_r2: Array
    center_z: Array
    tolerance: Array  # epsilon along z


def margin(splats: Splats, camera: Camera, settings: RenderSettings, epsilon: float) -> tuple[Array, Array]:
    """Return each pixel's margin: how near its nearest decision is to flipping.

    Parameters
    ----------
    splats, camera, settings
        As for `render`.
    epsilon : float
        The depth tolerance that was used, scene units.

    Returns
    -------
    margin : (H, W) float32
        In units of the decision's own float32 rounding error (splatcl/oracle.py), at most `MAX_MARGIN`.
    raw : (H, W) float32
        That decision's distance itself: of r from 1, of z from its limit in scene units; +inf where the
        margin is `MAX_MARGIN`.
    """
    shape = (camera.height, camera.width)
    units, raw = np.full(shape[0] * shape[1], MAX_MARGIN), np.full(shape[0] * shape[1], np.inf)
    projected = oracle.project(splats, camera, settings)
    for pairs in bands(projected, camera, settings):
        f = fragments(pairs, projected, camera, settings, epsilon)
        nearest, distance = decisions(pairs, f)
        best = pairs.least(nearest)
        is_best = nearest == best[pairs.run]
        units[pairs.pixel] = np.minimum(best, MAX_MARGIN)
        raw[pairs.pixel] = np.where(best < MAX_MARGIN, pairs.least(np.where(is_best, distance, np.inf)), np.inf)
    return units.reshape(shape).astype(np.float32), raw.reshape(shape).astype(np.float32)


def decisions(pairs: Pairs, f: Fragments) -> tuple[Array, Array]:
    """(K,) least margin, unsigned, of each pair's decisions, and the (K,) distance it stands for."""
    hit, filtered = f.hit_margin >= 0, f.filter_margin >= 0
    z = np.where(hit, f.hit_z, np.inf)
    depth = pairs.least(z)[pairs.run]
    front = pairs.least(np.where(hit & (z == depth), pairs.splat, NO_SPLAT))[pairs.run]
    is_front = front == pairs.splat
    front_scale = pairs.least(np.where(is_front, f.scale_z, np.inf))[pairs.run]
    fragment_z = np.where(hit, f.hit_z, f.center_z)
    fragment_scale = np.where(hit, f.scale_z, np.abs(f.center_z))
    margins, distances = [np.abs(f.hit_margin)], [np.abs(1 - np.nan_to_num(f.r3))]  # exactly edge-on: r3 is 0 / 0
    with np.errstate(invalid="ignore", over="ignore"):
        gap = np.where(hit & ~is_front, z - depth, np.inf)
        margins.append(np.where(hit & ~is_front, gap / (UNIT * (f.scale_z + front_scale)), np.inf))
        distances.append(gap)
        margins.append(np.where(hit, np.inf, np.abs(f.filter_margin)))
        distances.append(np.abs(1 - f.r2))
        slack = np.abs(depth + f.tolerance - fragment_z)
        tested = (hit | filtered) & ~is_front & np.isfinite(depth)
        margins.append(np.where(tested, slack / (UNIT * (fragment_scale + front_scale + f.tolerance)), np.inf))
        distances.append(slack)
    stacked = np.stack(margins)
    least = stacked.argmin(axis=0)
    columns = np.arange(len(least))
    return stacked[least, columns], np.stack(distances)[least, columns]


def fragments(
    pairs: Pairs,
    projected: oracle.ProjectedSplats,
    camera: Camera,
    settings: RenderSettings,
    epsilon: float,
    offset_error: float = oracle.OFFSET_ERROR,
) -> Fragments:
    """Evaluate the oracle's equations at each pair; `offset_error` is that of a projected centre, 2^-24 pixels."""
    own = take(projected, pairs.splat)
    own = replace(own, prefilter_error=np.maximum(own.prefilter_error, offset_error))
    hits = oracle._intersect(replace(oracle._discs(own, camera), offset_error=offset_error), camera, pairs.s)
    filter_margin = oracle._prefilter(own, camera, settings, pairs.s)[1]
    if settings.prefilter == "none":
        filter_margin = np.full(len(pairs.splat), -np.inf)
    tolerance = np.full(len(pairs.splat), epsilon)
    if settings.along == "ray":
        tolerance /= oracle._ray_length(camera, pairs.s)
    r2 = np.linalg.norm(oracle._raster(pairs.s, camera) - own.prefilter_point, axis=1) / settings.prefilter_radius
    return Fragments(
        hit_margin=np.where(np.isnan(hits.margin), -np.inf, hits.margin),
        hit_z=hits.z,
        scale_z=hits.scale_z,
        r3=hits.r,
        scale_r3=hits.scale_r,
        filter_margin=np.where(np.isnan(filter_margin), -np.inf, filter_margin),
        r2=r2,
        scale_r2=r2 + 2 * own.prefilter_error / settings.prefilter_radius,
        center_z=own.center_eye[:, 2],
        tolerance=tolerance,
    )


def bands(projected: oracle.ProjectedSplats, camera: Camera, settings: RenderSettings) -> Iterator[Pairs]:
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


def _wide_bounds(projected: oracle.ProjectedSplats, camera: Camera, settings: RenderSettings) -> NDArray[np.int64]:
    """(N, 4) first x, first y, last x, last y of the pixels a splat touches or nearly touches, in the image."""
    p, radius = projected, settings.prefilter_radius
    disc = oracle._disc_bounds(p.center_eye, p.tangent_u_eye, p.tangent_v_eye, camera)
    disc[oracle._out_of_range(p, camera)] = oracle.NOTHING
    square = np.hstack([p.prefilter_point - radius, p.prefilter_point + radius])
    square[~(p.prefilter_margin > -MAX_MARGIN)] = oracle.NOTHING
    low, high = np.minimum(disc, square)[:, :2], np.maximum(disc, square)[:, 2:]
    kappa = oracle._discs(p, camera).kappa
    with np.errstate(invalid="ignore"):
        size = (disc[:, 2:] - disc[:, :2]).max(axis=1, initial=0.0)
        slack = SLACK_PIXELS + np.nan_to_num(size * np.minimum(100.0, MAX_MARGIN * UNIT * (8 + 4 * kappa)), nan=0.0)
    low, high = low - 0.5 - slack[:, None], high - 0.5 + slack[:, None]
    hopeless = p.culled & (np.abs(p.facing_margin) > MAX_MARGIN)
    low[hopeless], high[hopeless] = np.inf, -np.inf
    last = np.array([camera.width - 1, camera.height - 1])
    first_pixel = np.ceil(np.clip(low, 0, last + 1)).astype(np.int64)
    last_pixel = np.floor(np.clip(high, -1, last)).astype(np.int64)
    return np.hstack([first_pixel, last_pixel])


def take(projected: oracle.ProjectedSplats, ids: Array) -> oracle.ProjectedSplats:
    """Return the rows `ids` of every field."""
    return oracle.ProjectedSplats(**{field.name: getattr(projected, field.name)[ids] for field in fields(projected)})
