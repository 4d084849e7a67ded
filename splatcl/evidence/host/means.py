"""Bounds of weights, weighted means and unit vectors over every outcome of the uncertain decisions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from splatcl.evidence.host.pairs import Array, Pairs
from splatcl.oracle.geometry.rays import UNIT

MAX_STEPS = 64
"""Most steps for a bound of a weighted mean; without convergence the bound of its values is used."""


@dataclass(frozen=True, eq=False)
class Choices:
    """Possible contributions of K pairs."""

    sure: Array  # (K,) bool, accepted whichever way the uncertain decisions fall
    possible: Array  # (K,) bool, accepted for some outcome of the uncertain decisions
    weight_low: Array  # (K,)
    weight_high: Array  # (K,)


def weight_bounds(pairs: Pairs, c: Choices) -> tuple[Array, Array]:
    """Return the (P,) least and greatest weight sum."""
    rounding = 2 * UNIT * pairs.total(c.possible.astype(np.float64))
    low, high = pairs.total(np.where(c.sure, c.weight_low, 0.0)), pairs.total(np.where(c.possible, c.weight_high, 0.0))
    return low * (1 - rounding), high * (1 + rounding)


def greatest_mean(pairs: Pairs, c: Choices, value: Array) -> Array:
    """Return the (P,) greatest sum(w v) / sum(w), w in [weight_low, weight_high] if sure, else in [0, weight_high].

    It is Dinkelbach's iteration: at a mean m, the best weights are the greatest where v > m and the least elsewhere.
    """
    highest = np.where(c.possible, c.weight_high, 0.0)
    lowest = np.where(c.sure, c.weight_low, 0.0)
    top = -pairs.least(np.where(c.possible, -value, np.inf))
    mean = pairs.least(np.where(c.possible, value, np.inf))
    for _ in range(MAX_STEPS):
        weight = np.where(value > mean[pairs.run], highest, lowest)
        total = pairs.total(weight)
        step = pairs.total(weight * value) / np.where(total > 0, total, 1.0)
        step = np.where(total > 0, np.maximum(step, mean), mean)
        if np.array_equal(step, mean):
            break
        mean = step
    else:
        mean = top
    rounding = 4 * UNIT * (pairs.total(c.possible.astype(np.float64)) + 4)
    largest = -pairs.least(np.where(c.possible, -np.abs(value), 0.0))
    return np.where(np.isfinite(mean), mean + rounding * largest, 0.0)


def normalized(low: Array, high: Array) -> tuple[Array, Array]:
    """Return (P, 3) bounds of v / |v| for v in a box; -1 to 1 if the box contains 0."""
    far2 = np.maximum(low**2, high**2)
    near2 = np.where((low <= 0) & (high >= 0), 0.0, np.minimum(low**2, high**2))
    others_far, others_near = far2.sum(axis=1, keepdims=True) - far2, near2.sum(axis=1, keepdims=True) - near2
    with np.errstate(divide="ignore", invalid="ignore"):
        low_n = low / np.sqrt(low**2 + np.where(low >= 0, others_far, others_near))
        high_n = high / np.sqrt(high**2 + np.where(high >= 0, others_near, others_far))
    holds_zero = (near2 == 0).all(axis=1, keepdims=True)
    nothing = (far2 == 0).all(axis=1, keepdims=True)
    low_n, high_n = np.where(holds_zero, -1.0, low_n - 8 * UNIT), np.where(holds_zero, 1.0, high_n + 8 * UNIT)
    return np.where(nothing, 0.0, low_n), np.where(nothing, 0.0, high_n)
