"""Envelopes: between what bounds each pixel of any correct renderer lands, whatever way its rounding falls.

A decision whose margin (splatcl/uncertainty.py) is within the tolerance may go either way, and every quantity may
be off by the tolerance times its own rounding error. A front splat that flips moves depth(p), and with it the epsilon
test of all others: so depth is bounded first, and fragments are then sure, possible or neither.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splatcl import oracle
from splatcl.camera import Camera
from splatcl.errors import SettingsError
from splatcl.oracle import UNIT
from splatcl.settings import RenderSettings
from splatcl.splats import Splats
from splatcl.uncertainty import MAX_MARGIN, Fragments, Pairs, bands, fragments

Array = NDArray[Any]
TOLERANCE = 32.0
"""Default tolerance, in units of each decision's own rounding error."""
MAX_STEPS = 64
"""Steps after which a bound of a weighted mean falls back to that of its values."""


@dataclass(frozen=True, eq=False)
class _Choices:
    """What each pair may contribute, (K,) each."""

    sure: Array  # accepted whatever way decisions fall
    possible: Array
    weight_low: Array
    weight_high: Array


def envelope(
    splats: Splats, camera: Camera, settings: RenderSettings, epsilon: float, tolerance: float = TOLERANCE
) -> dict[str, NDArray[np.float32]]:
    """Return the bounds of Z, weight, albedo and N over all outcomes of uncertain decisions.

    Parameters
    ----------
    splats, camera, settings
        As for `render`.
    epsilon : float
        The depth tolerance that was used, scene units.
    tolerance : float
        In units of each decision's own float32 rounding error, at most `uncertainty.MAX_MARGIN`. A projected
        centre's own error is taken to be 4 max(width, height) 2^-24 pixels, as of plain float32 arithmetic.

    Returns
    -------
    dict
        "Z.lo", "Z.hi", "weight.lo", "weight.hi" (H, W); "albedo.lo", "albedo.hi", "N.lo", "N.hi" (H, W, 3);
        float32, rounded outward. Z.hi is +inf where a pixel may have no hit; albedo and N include 0 where it
        may be uncovered.

    Raises
    ------
    SettingsError
        The tolerance is out of range.
    """
    check_tolerance(tolerance)
    num_pixels = camera.height * camera.width
    low, high = np.zeros((num_pixels, 8)), np.zeros((num_pixels, 8))  # Z, weight, albedo, N
    low[:, 0] = high[:, 0] = np.inf
    projected = oracle.project(splats, camera, settings)
    values = np.hstack([splats.color.astype(np.float64), projected.normal_eye])
    unsure_facing = np.abs(projected.facing_margin) <= tolerance
    offset_error = 4.0 * max(camera.width, camera.height)
    for pairs in bands(projected, camera, settings):
        f = fragments(pairs, projected, camera, settings, epsilon, offset_error)
        low[pairs.pixel, 0], high[pairs.pixel, 0] = z_low, z_high = _depth(pairs, f, tolerance)
        choices, never_empty = _choices(pairs, f, settings, tolerance, z_low, z_high)
        low[pairs.pixel, 1], high[pairs.pixel, 1] = _weights(pairs, choices)
        own = values[pairs.splat]
        flipped = np.where(unsure_facing[pairs.splat, None], -own[:, 3:], own[:, 3:])
        least = np.hstack([own[:, :3], np.minimum(own[:, 3:], flipped)])
        most = np.hstack([own[:, :3], np.maximum(own[:, 3:], flipped)])
        mean_low = -np.stack([_greatest_mean(pairs, choices, -least[:, k]) for k in range(6)], axis=1)
        mean_high = np.stack([_greatest_mean(pairs, choices, most[:, k]) for k in range(6)], axis=1)
        mean_low[:, 3:], mean_high[:, 3:] = _normalized(mean_low[:, 3:], mean_high[:, 3:])
        zero = ~never_empty[:, None]
        low[pairs.pixel, 2:] = np.where(zero, np.minimum(mean_low, 0.0), mean_low)
        high[pairs.pixel, 2:] = np.where(zero, np.maximum(mean_high, 0.0), mean_high)
    return _named(low, high, camera)


def check_tolerance(tolerance: float) -> None:
    """Raise `SettingsError` where the tolerance is out of range."""
    if not 0 < tolerance <= MAX_MARGIN:
        raise SettingsError(f"tolerance {tolerance} must be above 0 and at most {MAX_MARGIN:g}")


def _depth(pairs: Pairs, f: Fragments, tolerance: float) -> tuple[Array, Array]:
    """(P,) least and greatest visibility depth."""
    error = tolerance * UNIT * f.scale_z
    low = pairs.least(np.where(f.hit_margin > -tolerance, f.hit_z - error, np.inf))
    high = pairs.least(np.where(f.hit_margin > tolerance, f.hit_z + error, np.inf))
    return low, high


def _choices(
    pairs: Pairs, f: Fragments, settings: RenderSettings, tolerance: float, z_low: Array, z_high: Array
) -> tuple[_Choices, Array]:
    """Say what each pair may contribute, and (P,) which pixels are covered in any case."""
    hit_sure, hit_possible = f.hit_margin > tolerance, f.hit_margin > -tolerance
    filter_sure, filter_possible = f.filter_margin > tolerance, f.filter_margin > -tolerance
    error, center_error = tolerance * UNIT * f.scale_z, tolerance * UNIT * np.abs(f.center_z)
    by_center = ~hit_sure & filter_possible
    low = np.minimum(
        np.where(hit_possible, f.hit_z - error, np.inf), np.where(by_center, f.center_z - center_error, np.inf)
    )
    high = np.maximum(
        np.where(hit_possible, f.hit_z + error, -np.inf), np.where(by_center, f.center_z + center_error, -np.inf)
    )
    hit_low = np.where(hit_possible, f.hit_z - error, np.inf)
    # A splat in front of all others in any case sets depth(p) itself and is accepted; else one of those that may.
    is_first = hit_low == pairs.least(hit_low)[pairs.run]
    second = pairs.least(np.where(is_first, np.inf, hit_low))[pairs.run]
    alone = pairs.total(is_first.astype(np.int64))[pairs.run] == 1
    front = hit_sure & is_first & alone & (f.hit_z + error < second)
    slack = 2 * tolerance * UNIT * f.tolerance
    sure = (hit_sure | filter_sure) & (high <= z_low[pairs.run] + f.tolerance - slack) | front
    possible = (hit_possible | filter_possible) & (low <= z_high[pairs.run] + f.tolerance + slack)
    weight_low, weight_high = _pair_weights(f, settings, tolerance)
    may_be_front = hit_possible & (hit_low <= z_high[pairs.run])
    choices = _Choices(sure, possible & (weight_high > 0), weight_low, weight_high)
    certain = np.isfinite(z_high) & (pairs.least(np.where(may_be_front, weight_low, np.inf)) > 0)
    return choices, certain | (pairs.total(np.where(sure, weight_low, 0.0)) > 0)


def _pair_weights(f: Fragments, settings: RenderSettings, tolerance: float) -> tuple[Array, Array]:
    """(K,) least and greatest weight of each fragment, if it exists."""
    hit_sure, hit_possible = f.hit_margin > tolerance, f.hit_margin > -tolerance
    filter_sure, filter_possible = f.filter_margin > tolerance, f.filter_margin > -tolerance
    e3, e2 = tolerance * UNIT * f.scale_r3, tolerance * UNIT * f.scale_r2
    r_low = np.minimum(np.where(hit_possible, f.r3 - e3, 1.0), np.where(filter_possible, f.r2 - e2, 1.0))
    r_high = np.minimum(np.where(hit_sure, f.r3 + e3, 1.0), np.where(filter_sure, f.r2 + e2, 1.0))
    r_low, r_high = np.clip(r_low, 0.0, 1.0), np.clip(r_high, 0.0, 1.0)
    if settings.kernel == "table":
        low, high = _table_range(settings, r_low, r_high)
    else:
        low, high = oracle._weight(r_high**2, settings), oracle._weight(r_low**2, settings)
    rounding = tolerance * UNIT * (1 + settings.cutoff**2 / 2)
    return low * (1 - rounding), high * (1 + rounding)


def _table_range(settings: RenderSettings, r_low: Array, r_high: Array) -> tuple[Array, Array]:
    """(K,) least and greatest weight that a table gives between two radii.

    Those at the ends, and of all samples in between, by overlapping runs of a power of two.
    """
    table = np.array(settings.kernel_table)
    ends = oracle._weight(r_low**2, settings), oracle._weight(r_high**2, settings)
    low, high = np.minimum(*ends), np.maximum(*ends)
    rounding = 0.5 if settings.kernel_lookup == "nearest" else 0.0
    first = np.ceil(r_low * (len(table) - 1) - rounding).astype(np.int64)
    last = np.floor(r_high * (len(table) - 1) + rounding).astype(np.int64)
    length = last - first + 1
    least, most, span = table, table, 1
    while span <= len(table):
        fits = (length >= span) & (length < 2 * span)
        a, b = first[fits], last[fits] - span + 1
        low[fits] = np.minimum(low[fits], np.minimum(least[a], least[b]))
        high[fits] = np.maximum(high[fits], np.maximum(most[a], most[b]))
        least, most = np.minimum(least[:-span], least[span:]), np.maximum(most[:-span], most[span:])
        span *= 2
    return low, high


def _weights(pairs: Pairs, c: _Choices) -> tuple[Array, Array]:
    """(P,) least and greatest weight sum."""
    rounding = 2 * UNIT * pairs.total(c.possible.astype(np.float64))
    low, high = pairs.total(np.where(c.sure, c.weight_low, 0.0)), pairs.total(np.where(c.possible, c.weight_high, 0.0))
    return low * (1 - rounding), high * (1 + rounding)


def _greatest_mean(pairs: Pairs, c: _Choices, value: Array) -> Array:
    """(P,) greatest sum(w v) / sum(w), w in [weight_low, weight_high] if sure, else in [0, weight_high].

    Dinkelbach's iteration: at a mean m, the best weights are the greatest where v > m and the least elsewhere.
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


def _normalized(low: Array, high: Array) -> tuple[Array, Array]:
    """(P, 3) bounds of v / |v| for v in a box; -1 to 1 where it holds 0."""
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


def _named(low: Array, high: Array, camera: Camera) -> dict[str, NDArray[np.float32]]:
    """Cut the columns into AOVs, rounded outward to float32."""
    columns: dict[str, Any] = {"Z": 0, "weight": 1, "albedo": slice(2, 5), "N": slice(5, 8)}
    result = {}
    for name, column in columns.items():
        for suffix, values, away in (("lo", low, -np.inf), ("hi", high, np.inf)):
            exact = values[:, column]
            rounded = exact.astype(np.float32)
            wrong = rounded > exact if suffix == "lo" else rounded < exact
            rounded = np.where(wrong, np.nextafter(rounded, np.float32(away)), rounded)
            result[f"{name}.{suffix}"] = rounded.reshape(camera.height, camera.width, *exact.shape[1:])
    return result
