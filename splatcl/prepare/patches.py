"""Patches of splats that a single larger one can stand for, and a choice of them that covers all (see decimate.py)."""

from __future__ import annotations

import heapq
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splatcl.prepare.normal_fields import fit_slopes
from splatcl.prepare.voronoi import principal, tangent_frame
from splatcl.util.progress import stage

MAX_ASPECT = 4.0
"""Largest ratio of the radii of the ellipse in which a patch grows."""
LEVELS = (32, 128, 512, 2048)
"""Nearest splats that a patch may cover; more are looked at where the fewer did not stop it."""
ENOUGH = 16
"""A splat in so many patches gets none of its own, so that the work does not grow with the patches' size."""
LOPSIDED = 0.2
"""A patch does not reach so far beyond the surface's boundary that its mean is off by more than this share of it: by
half its radius, about. The mean of half a disc is off by 0.42."""
MIN_FILL = 0.5
"""A patch does not reach so far over a gap that its discs' areas are less than this share of its own."""
FEW = 8
"""So many splats may be lopsided by chance."""
BLOCK = 1024
"""Patches that are grown at a time."""
PAIRS = 1 << 18
"""Pairs of splats that are looked at together: the temporaries are a few tens of MB."""


@dataclass(frozen=True)
class Surface:
    """Splats as float64 arrays near the origin, and the bounds of a patch."""

    center: NDArray[np.float64]  # (N, 3), scene units
    normal: NDArray[np.float64]  # (N, 3)
    area: NDArray[np.float64]  # (N,), |t_u x t_v|, square scene units
    oriented: bool
    tree: Any  # of the centers
    error: float  # scene units
    angle: float  # radians


@dataclass(frozen=True)
class Patches:
    """The patch i is about the splat seed[i] and has the splats ids[begin[i] : begin[i + 1]]."""

    seed: NDArray[np.intp]
    begin: NDArray[np.intp]
    ids: NDArray[np.intp]

    @classmethod
    def joined(
        cls, seeds: list[NDArray[np.intp]], sizes: list[NDArray[np.intp]], ids: list[NDArray[np.intp]]
    ) -> Patches:
        """Make patches of lists of arrays: seeds, numbers of splats, splats."""
        return cls(np.concatenate(seeds), np.concatenate([[0], np.concatenate(sizes).cumsum()]), np.concatenate(ids))

    def __len__(self) -> int:
        return len(self.seed)

    def splats(self, i: int) -> NDArray[np.intp]:
        """Return the splats of the patch i."""
        return self.ids[self.begin[i] : self.begin[i + 1]]

    def take(self, chosen: NDArray[np.intp]) -> Patches:
        """Return some of the patches."""
        return self.joined([self.seed[chosen]], [np.diff(self.begin)[chosen]], [self.splats(i) for i in chosen])


def grow(surface: Surface) -> Patches:
    """Grow patches about splats, in a random but fixed order, until each splat is in one or more."""
    num = len(surface.center)
    times_covered = np.zeros(num, np.intp)
    order = np.random.default_rng(0).permutation(num)
    seeds, sizes, ids = [], [], []
    with stage("Growing splats", num) as advance:
        for start in range(0, num, BLOCK):
            pending = order[start : start + BLOCK]
            for level in LEVELS:
                left = []
                for chunk in _chunks(pending, PAIRS // level):
                    chunk = chunk[times_covered[chunk] < ENOUGH]
                    near, covered, stopped = _grow(surface, chunk, min(level, num))
                    done = stopped | (level == LEVELS[-1])
                    seeds.append(chunk[done])
                    sizes.append(covered[done].sum(axis=1))
                    ids.append(near[done][covered[done]])
                    times_covered += np.bincount(ids[-1], minlength=num)
                    left.append(chunk[~done])
                pending = np.concatenate(left) if left else pending[:0]
            advance(min(BLOCK, num - start))
    return Patches.joined(seeds, sizes, ids)


def _chunks(values: NDArray[np.intp], size: int) -> Iterator[NDArray[np.intp]]:
    for start in range(0, len(values), size):
        yield values[start : start + size]


@dataclass(frozen=True)
class _Around:
    """The nearest splats of some seeds, (C, K) each: where they are in a seed's tangent frame, and what they are."""

    x: NDArray[np.float64]
    y: NDArray[np.float64]
    height: NDArray[np.float64]
    area: NDArray[np.float64]
    forbidden: NDArray[np.bool_]  # stops the growth
    elsewhere: NDArray[np.bool_]  # of another sheet of the surface: neither covered nor a stop
    reach: NDArray[np.float64]  # (C,) distance within which there are no others


def _grow(
    surface: Surface, seeds: NDArray[np.intp], num: int
) -> tuple[NDArray[np.intp], NDArray[np.bool_], NDArray[np.bool_]]:
    """Grow a patch about each seed over its `num` nearest splats: first in a circle, then in an ellipse.

    The ellipse is long where the surface is less curved; the better of the two counts.

    Returns
    -------
    ids : (C, num) int array
        The nearest splats.
    covered : (C, num) bool array
        Which of them are in the patch.
    stopped : (C,) bool array
        Whether a splat stopped the growth, or there are no more; not the end of the list.
    """
    ids, around, slopes = _look_around(surface, seeds, num)
    circle, stopped = _extent(around, surface.error, np.zeros(len(seeds)), np.ones(len(seeds)))
    rows = np.repeat(np.arange(len(seeds)), num)
    xy = np.stack([around.x.ravel(), around.y.ravel()])
    turn, aspect = _low_curvature(fit_slopes(rows, xy, slopes, circle.ravel(), len(seeds)))
    ellipse, ellipse_stopped = _extent(around, surface.error, turn, aspect)
    better = ellipse.sum(axis=1) > circle.sum(axis=1)
    return ids, np.where(better[:, None], ellipse, circle), stopped & ellipse_stopped


def _look_around(
    surface: Surface, seeds: NDArray[np.intp], num: int
) -> tuple[NDArray[np.intp], _Around, NDArray[np.float64]]:
    """Return the (C, num) nearest splats of the seeds, themselves first, and the (C num, 2) slopes of their normals."""
    distance, ids = surface.tree.query(surface.center[seeds], np.arange(1, num + 1), workers=-1)
    # Of splats at one place any may come first.
    ids = np.where(ids == seeds[:, None], ids[:, :1], ids)
    ids[:, 0] = seeds
    frame = np.stack([*tangent_frame(surface.normal[seeds]), surface.normal[seeds]])
    x, y, height = np.einsum("cki,fci->fck", surface.center[ids] - surface.center[seeds][:, None], frame)
    along_x, along_y, cosine = np.einsum("cki,fci->fck", surface.normal[ids], frame)
    same_side = cosine > 0 if surface.oriented else cosine != 0
    least = np.cos(surface.angle)
    forbidden = (cosine if surface.oriented else np.abs(cosine)) < least
    # A sheet whose normals are within the angle cannot rise faster than this.
    elsewhere = ~same_side | (np.abs(height) > np.maximum(2 * surface.error, np.tan(surface.angle) * np.hypot(x, y)))
    whole = num == len(surface.center)
    reach = np.where(whole, np.inf, distance[:, -1])
    slopes = np.stack([along_x, along_y], axis=-1) / np.where(forbidden, 1.0, cosine)[..., None]
    area = surface.area[ids] * ~elsewhere
    return ids, _Around(x, y, height, area, forbidden & ~elsewhere, elsewhere, reach), slopes.reshape(-1, 2)


def _extent(
    around: _Around, error: float, turn: NDArray[np.float64], aspect: NDArray[np.float64]
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Grow ellipses of an aspect whose longer axis is turned by `turn` from x, until a splat stops them.

    Returns
    -------
    covered : (C, K) bool array
    stopped : (C,) bool array
        False where splats beyond those around might have been covered.
    """
    cos, sin = np.cos(turn)[:, None], np.sin(turn)[:, None]
    long, short = (cos * around.x + sin * around.y) / aspect[:, None], cos * around.y - sin * around.x
    size = np.sqrt(long**2 + (around.height / aspect[:, None]) ** 2 + short**2)
    order = np.argsort(size, axis=1, kind="stable")

    def sort(values: NDArray[Any]) -> NDArray[Any]:
        return np.take_along_axis(values, order, axis=1)

    height = sort(np.where(around.elsewhere, 0.0, around.height))
    span = np.maximum.accumulate(height, axis=1) - np.minimum.accumulate(height, axis=1)
    total, moment_long, moment_short = (
        np.cumsum(sort(around.area * values), axis=1) for values in (np.ones_like(long), long, short)
    )
    size = sort(size)
    lopsided = np.hypot(moment_long, moment_short) > LOPSIDED * total * size
    lopsided[:, :FEW] = False
    sparse = total < MIN_FILL * aspect[:, None] * size**2
    stops = sort(around.forbidden) | (span > 2 * error) | lopsided | sparse
    known = size <= (around.reach / aspect)[:, None]
    grown = known & ~np.logical_or.accumulate(stops, axis=1)
    covered = np.empty_like(grown)
    np.put_along_axis(covered, order, grown, axis=1)
    return covered & ~around.elsewhere, (stops & known).any(axis=1) | np.isinf(around.reach)


def _low_curvature(slopes: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return (C,) directions (from x, radians) of the lower curvature and aspects, from (2, C, 2) slopes by x and y."""
    xy = 0.5 * (slopes[0, :, 1] + slopes[1, :, 0])
    mean, spread, turn = principal(slopes[0, :, 0], xy, slopes[1, :, 1])
    turn += 0.5 * np.pi * (mean > 0)
    high, low = np.abs(mean) + spread, np.abs(np.abs(mean) - spread)
    return turn, np.sqrt(np.clip(high / np.maximum(low, np.finfo(float).tiny), 1.0, MAX_ASPECT**2))


def cover(patches: Patches, num: int) -> NDArray[np.intp]:
    """Return patches that together have all of `num` splats: ever the one with the most that none has yet.

    In the end those are left out whose splats others have too.
    """
    times = np.zeros(num, np.intp)
    sizes = np.diff(patches.begin)
    queue = [(-int(size), i) for i, size in enumerate(sizes)]
    heapq.heapify(queue)
    chosen = []
    with stage("Choosing splats", num) as advance:
        while queue:
            gain, i = queue[0]
            left = -int(np.count_nonzero(times[patches.splats(i)] == 0))
            if left > gain and left:
                heapq.heapreplace(queue, (left, i))
                continue
            heapq.heappop(queue)
            if left:
                chosen.append(i)
                times[patches.splats(i)] += 1
                advance(-left)
    kept = []
    for i in reversed(chosen):
        if (times[patches.splats(i)] > 1).all():
            times[patches.splats(i)] -= 1
        else:
            kept.append(i)
    return np.array(kept[::-1], np.intp)
