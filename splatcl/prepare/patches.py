"""Patches: sets of splats that one larger splat can replace; and a choice of patches that covers all splats.

decimate.py turns the chosen patches into splats.
"""

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
"""Largest ratio of the radii of a patch's ellipse."""
LEVELS = (32, 128, 512, 2048)
"""Numbers of nearest splats for the growth of a patch; the next number is tried if no splat stopped the growth."""
ENOUGH = 16
"""Number of patches of a splat from which it seeds no patch, so that the work does not grow with the patches' size."""
LOPSIDED = 0.2
"""Largest distance of a patch's mean from its seed, in units of its radius: a patch beyond the surface's boundary
exceeds it. The mean of half a disc is at 0.42; a patch may pass the boundary by about half its radius."""
MIN_FILL = 0.5
"""Least ratio of the areas of a patch's discs to its own area: a patch over a gap falls below it."""
FEW = 8
"""Number of splats up to which a patch may be lopsided by chance."""
BLOCK = 1024
"""Patches grown at a time."""
PAIRS = 1 << 18
"""Pairs of splats held at a time: their temporaries take a few tens of MB."""


@dataclass(frozen=True)
class Samples:
    """Splats as float64 arrays relative to their mean center, and the bounds of a patch."""

    center: NDArray[np.float64]  # (N, 3), scene units
    normal: NDArray[np.float64]  # (N, 3) unit normals
    area: NDArray[np.float64]  # (N,) |t_u x t_v|, square scene units
    oriented: bool  # whether the signs of the normals count
    tree: Any  # search tree of the centers
    error: float  # largest distance from the patch's plane, scene units
    angle: float  # largest angle to the seed's normal, radians


@dataclass(frozen=True)
class Patches:
    """P patches; patch i grew about the splat seed[i] and has the splats ids[begin[i] : begin[i + 1]]."""

    seed: NDArray[np.intp]  # (P,)
    begin: NDArray[np.intp]  # (P + 1,)
    ids: NDArray[np.intp]  # (begin[P],)

    @classmethod
    def joined(
        cls, seeds: list[NDArray[np.intp]], sizes: list[NDArray[np.intp]], ids: list[NDArray[np.intp]]
    ) -> Patches:
        """Join lists of arrays: seeds, numbers of splats, splats."""
        return cls(np.concatenate(seeds), np.concatenate([[0], np.concatenate(sizes).cumsum()]), np.concatenate(ids))

    def __len__(self) -> int:
        return len(self.seed)

    def splats(self, i: int) -> NDArray[np.intp]:
        """Return the splats of patch i."""
        return self.ids[self.begin[i] : self.begin[i + 1]]

    def take(self, chosen: NDArray[np.intp]) -> Patches:
        """Return the patches with the indices `chosen`."""
        return self.joined([self.seed[chosen]], [np.diff(self.begin)[chosen]], [self.splats(i) for i in chosen])


def grow(samples: Samples) -> Patches:
    """Grow patches about splats, in a random but fixed order, until each splat is in at least one patch."""
    num = len(samples.center)
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
                    nearest, covered, stopped = _grow(samples, chunk, min(level, num))
                    done = stopped | (level == LEVELS[-1])
                    seeds.append(chunk[done])
                    sizes.append(covered[done].sum(axis=1))
                    ids.append(nearest[done][covered[done]])
                    times_covered += np.bincount(ids[-1], minlength=num)
                    left.append(chunk[~done])
                pending = np.concatenate(left) if left else pending[:0]
            advance(min(BLOCK, num - start))
    return Patches.joined(seeds, sizes, ids)


def _chunks(values: NDArray[np.intp], size: int) -> Iterator[NDArray[np.intp]]:
    for start in range(0, len(values), size):
        yield values[start : start + size]


@dataclass(frozen=True)
class _Nearest:
    """The K nearest splats of C seeds in the seeds' tangent frames; (C, K) arrays, scene units."""

    x: NDArray[np.float64]
    y: NDArray[np.float64]
    height: NDArray[np.float64]
    area: NDArray[np.float64]
    forbidden: NDArray[np.bool_]  # stops the growth
    other_sheet: NDArray[np.bool_]  # of another sheet of the surface: not covered, does not stop the growth
    reach: NDArray[np.float64]  # (C,) radius of the ball about the seed without further splats


def _grow(
    samples: Samples, seeds: NDArray[np.intp], num: int
) -> tuple[NDArray[np.intp], NDArray[np.bool_], NDArray[np.bool_]]:
    """Grow a patch about each seed over its `num` nearest splats: once in a circle, once in an ellipse.

    The ellipse is long in the direction of the lower curvature. The shape with more splats is returned.

    Returns
    -------
    ids : (C, num) int array
        The nearest splats.
    covered : (C, num) bool array
        Whether each is in the patch.
    stopped : (C,) bool array
        Whether a splat stopped the growth, or `num` is all splats; False if the list of nearest splats ended it.
    """
    ids, nearest, slopes = _nearest_splats(samples, seeds, num)
    circle, stopped = _extent(nearest, samples.error, np.zeros(len(seeds)), np.ones(len(seeds)))
    rows = np.repeat(np.arange(len(seeds)), num)
    xy = np.stack([nearest.x.ravel(), nearest.y.ravel()])
    turn, aspect = _low_curvature(fit_slopes(rows, xy, slopes, circle.ravel(), len(seeds)))
    ellipse, ellipse_stopped = _extent(nearest, samples.error, turn, aspect)
    better = ellipse.sum(axis=1) > circle.sum(axis=1)
    return ids, np.where(better[:, None], ellipse, circle), stopped & ellipse_stopped


def _nearest_splats(
    samples: Samples, seeds: NDArray[np.intp], num: int
) -> tuple[NDArray[np.intp], _Nearest, NDArray[np.float64]]:
    """Return the (C, num) nearest splats of the seeds, each seed first, and (C num, 2) slopes of their normals."""
    distance, ids = samples.tree.query(samples.center[seeds], np.arange(1, num + 1), workers=-1)
    # The search returns coincident splats in any order.
    ids = np.where(ids == seeds[:, None], ids[:, :1], ids)
    ids[:, 0] = seeds
    frame = np.stack([*tangent_frame(samples.normal[seeds]), samples.normal[seeds]])
    x, y, height = np.einsum("cki,fci->fck", samples.center[ids] - samples.center[seeds][:, None], frame)
    along_x, along_y, cosine = np.einsum("cki,fci->fck", samples.normal[ids], frame)
    same_side = cosine > 0 if samples.oriented else cosine != 0
    forbidden = (cosine if samples.oriented else np.abs(cosine)) < np.cos(samples.angle)
    # A sheet with normals within the angle cannot rise faster than this.
    steepest = np.maximum(2 * samples.error, np.tan(samples.angle) * np.hypot(x, y))
    other_sheet = ~same_side | (np.abs(height) > steepest)
    reach = np.where(num == len(samples.center), np.inf, distance[:, -1])
    slopes = np.stack([along_x, along_y], axis=-1) / np.where(forbidden, 1.0, cosine)[..., None]
    area = samples.area[ids] * ~other_sheet
    return ids, _Nearest(x, y, height, area, forbidden & ~other_sheet, other_sheet, reach), slopes.reshape(-1, 2)


def _extent(
    nearest: _Nearest, error: float, turn: NDArray[np.float64], aspect: NDArray[np.float64]
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Grow ellipses of the given aspects until a splat stops them; `turn` is the longer axis's angle from x, radians.

    Returns
    -------
    covered : (C, K) bool array
    stopped : (C,) bool array
        False if a splat beyond the K nearest ones might be covered too.
    """
    cos, sin = np.cos(turn)[:, None], np.sin(turn)[:, None]
    long, short = (cos * nearest.x + sin * nearest.y) / aspect[:, None], cos * nearest.y - sin * nearest.x
    size = np.sqrt(long**2 + (nearest.height / aspect[:, None]) ** 2 + short**2)
    order = np.argsort(size, axis=1, kind="stable")

    def sort(values: NDArray[Any]) -> NDArray[Any]:
        return np.take_along_axis(values, order, axis=1)

    height = sort(np.where(nearest.other_sheet, 0.0, nearest.height))
    height_range = np.maximum.accumulate(height, axis=1) - np.minimum.accumulate(height, axis=1)
    total, moment_long, moment_short = (
        np.cumsum(sort(nearest.area * values), axis=1) for values in (np.ones_like(long), long, short)
    )
    size = sort(size)
    lopsided = np.hypot(moment_long, moment_short) > LOPSIDED * total * size
    lopsided[:, :FEW] = False
    sparse = total < MIN_FILL * aspect[:, None] * size**2
    stops = sort(nearest.forbidden) | (height_range > 2 * error) | lopsided | sparse
    known = size <= (nearest.reach / aspect)[:, None]
    grown = known & ~np.logical_or.accumulate(stops, axis=1)
    covered = np.empty_like(grown)
    np.put_along_axis(covered, order, grown, axis=1)
    return covered & ~nearest.other_sheet, (stops & known).any(axis=1) | np.isinf(nearest.reach)


def _low_curvature(slopes: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return (C,) angles of the lower curvature from x, radians, and (C,) aspects, from (2, C, 2) slopes by x and y."""
    xy = 0.5 * (slopes[0, :, 1] + slopes[1, :, 0])
    mean, spread, turn = principal(slopes[0, :, 0], xy, slopes[1, :, 1])
    turn += 0.5 * np.pi * (mean > 0)
    high, low = np.abs(mean) + spread, np.abs(np.abs(mean) - spread)
    return turn, np.sqrt(np.clip(high / np.maximum(low, np.finfo(float).tiny), 1.0, MAX_ASPECT**2))


def cover(patches: Patches, num: int) -> NDArray[np.intp]:
    """Choose patches that together cover all of `num` splats, by a greedy set cover; return their indices.

    Each step chooses the patch with the most uncovered splats. Finally, patches whose splats all lie in other chosen
    patches are dropped.
    """
    times_covered = np.zeros(num, np.intp)
    sizes = np.diff(patches.begin)
    queue = [(-int(size), i) for i, size in enumerate(sizes)]  # a heap pops its least entry
    heapq.heapify(queue)
    chosen = []
    with stage("Choosing splats", num) as advance:
        while queue:
            stored, i = queue[0]
            current = -int(np.count_nonzero(times_covered[patches.splats(i)] == 0))
            if current > stored and current:
                heapq.heapreplace(queue, (current, i))
                continue
            heapq.heappop(queue)
            if current:
                chosen.append(i)
                times_covered[patches.splats(i)] += 1
                advance(-current)
    kept = []
    for i in reversed(chosen):
        if (times_covered[patches.splats(i)] > 1).all():
            times_covered[patches.splats(i)] -= 1
        else:
            kept.append(i)
    return np.array(kept[::-1], np.intp)
