"""Envelopes on the host: bounds of each pixel over all correct renderers (docs/trust/uncertainty.md).

A decision whose margin is within the tolerance may fall either way. Every quantity may be off by the tolerance times
its own rounding error. A front splat that flips moves depth(p), and so the epsilon test of all other splats. Depth is
therefore bounded first; then each fragment is sure, possible or neither.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splatcl.errors import SettingsError
from splatcl.evidence.host.means import Choices, greatest_mean, normalized, weight_bounds
from splatcl.evidence.host.pairs import MAX_MARGIN, Fragments, Pairs, bands, fragments
from splatcl.oracle.buffers import Array, ProjectedSplats
from splatcl.oracle.geometry.fragments import kernel_weight, table_position
from splatcl.oracle.geometry.rays import UNIT
from splatcl.oracle.project import project
from splatcl.scene.camera import Camera
from splatcl.scene.settings import RenderSettings
from splatcl.scene.splats import Splats

TOLERANCE = 32.0
"""Default tolerance, in units of each decision's own rounding error."""
COARSE = ("float16", "float16_clamped", "unorm8")
"""Targets whose sums are too coarse for useful bounds."""


def envelope(
    splats: Splats, camera: Camera, settings: RenderSettings, epsilon: float, tolerance: float = TOLERANCE
) -> dict[str, NDArray[np.float32]]:
    """Return the bounds of Z, weight, albedo and N over all outcomes of uncertain decisions.

    Parameters
    ----------
    splats, camera, settings
        As for `render`.
    epsilon : float
        Depth tolerance of the render, scene units.
    tolerance : float
        In units of each decision's own float32 rounding error, at most `MAX_MARGIN`. A projected center's error is
        4 max(width, height) 2^-24 pixels, that of plain float32 arithmetic.

    Returns
    -------
    dict
        "Z.lo", "Z.hi", "weight.lo", "weight.hi" (H, W); "albedo.lo", "albedo.hi", "N.lo", "N.hi" (H, W, 3);
        float32, rounded outward. Z.hi is +inf where a pixel may have no hit. Albedo and N include 0 where a pixel may
        be uncovered. Forward shading has no bounds of albedo, since it blends shaded colors.

    Raises
    ------
    SettingsError
        The tolerance is out of range, or the target's sums have no bounds.
    """
    validate(settings, tolerance)
    num_pixels = camera.height * camera.width
    low, high = np.zeros((num_pixels, 8)), np.zeros((num_pixels, 8))  # Z, weight, albedo, N
    low[:, 0] = high[:, 0] = np.inf
    projected = project(splats, camera, settings)
    color = splats.color.astype(np.float64)
    offset_error = 4.0 * max(camera.width, camera.height)
    for pairs in bands(projected, camera, settings):
        f = fragments(pairs, projected, camera, settings, epsilon, offset_error)
        may = _States.of(f, tolerance)
        choices, covered, depth = _choices(pairs, f, may, settings, tolerance)
        low[pairs.pixel, 0], high[pairs.pixel, 0] = depth
        low[pairs.pixel, 1], high[pairs.pixel, 1] = weight_bounds(pairs, choices)
        own, normals = color[pairs.splat], _normals(pairs, f, may, projected, settings, tolerance)
        least, most = (np.hstack([own, end]) for end in normals)
        mean_low = -np.stack([greatest_mean(pairs, choices, -least[:, k]) for k in range(6)], axis=1)
        mean_high = np.stack([greatest_mean(pairs, choices, most[:, k]) for k in range(6)], axis=1)
        mean_low[:, 3:], mean_high[:, 3:] = normalized(mean_low[:, 3:], mean_high[:, 3:])
        may_be_empty = ~covered[:, None]
        low[pairs.pixel, 2:] = np.where(may_be_empty, np.minimum(mean_low, 0.0), mean_low)
        high[pairs.pixel, 2:] = np.where(may_be_empty, np.maximum(mean_high, 0.0), mean_high)
    return without_blended_light(_named(low, high, camera), settings)


def validate(settings: RenderSettings, tolerance: float) -> None:
    """Raise `SettingsError` if a frame of these settings has no envelope, or the tolerance is out of range."""
    if not 0 < tolerance <= MAX_MARGIN:
        raise SettingsError(f"tolerance {tolerance} must be above 0 and at most {MAX_MARGIN:g}")
    if settings.target in COARSE:
        raise SettingsError(
            f"target={settings.target!r} has no envelope: it rounds sums too coarsely for useful bounds; "
            "choose target='float32'"
        )


def without_blended_light(
    named: dict[str, NDArray[np.float32]], settings: RenderSettings
) -> dict[str, NDArray[np.float32]]:
    """Return the bounds of the AOVs that a frame has: forward shading blends shaded colors, so it has no albedo."""
    return {name: image for name, image in named.items() if settings.shading == "deferred" or name[:6] != "albedo"}


@dataclass(frozen=True, eq=False)
class _States:
    """Which parts of K pairs exist in any case, and which may exist; (K,) bool each."""

    disc_sure: Array
    disc_possible: Array
    hit_sure: Array
    hit_possible: Array
    drawn_sure: Array
    drawn_possible: Array
    filter_sure: Array
    filter_possible: Array

    @classmethod
    def of(cls, f: Fragments, tolerance: float) -> _States:
        parts = (f.disc, f.hit, f.drawn, f.filter)
        return cls(*(part.margin > side for part in parts for side in (tolerance, -tolerance)))


def _depths(f: Fragments, may: _States, tolerance: float) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Return the (K,) least and greatest depth of each hit, and of each fragment, if it exists.

    They include the disc's depth where the ray may hit it, except for fragments of discs under a strict epsilon of 0,
    which rejects them. They include the center's depth where the ray may miss the
    disc but hit the elliptical footprint, or for fragments also the pre-filter. The pre-filter's depth may be the
    plane's instead. Fragments at depth(p) are left out.
    """
    error, center_error = tolerance * UNIT * f.disc.scale_z, tolerance * UNIT * np.abs(f.center_z)
    disc_low = np.where(may.disc_possible, f.disc.z - error, np.inf)
    disc_high = np.where(may.disc_possible, f.disc.z + error, -np.inf)
    ends = []
    rejected = f.strict & (f.tolerance == 0) & (not f.of_ellipses)
    tested_low = np.where(rejected, np.inf, disc_low)
    by_filter = may.filter_possible & ~may.disc_sure & (f.filter_depth != "front")
    tested_high = disc_high
    if f.filter_depth == "plane":
        plane = by_filter & (f.disc.plane_margin > -tolerance)
        tested_low = np.minimum(tested_low, np.where(plane, f.disc.z - error, np.inf))
        tested_high = np.maximum(tested_high, np.where(plane, f.disc.z + error, -np.inf))
        by_filter = by_filter & (f.disc.plane_margin <= tolerance)
    of_ellipses = f.of_ellipses & ~may.disc_sure
    for by_center, own_low, own_high in (
        (of_ellipses, disc_low, disc_high),
        (by_filter | of_ellipses, tested_low, tested_high),
    ):
        low = np.minimum(own_low, np.where(by_center, f.center_z - center_error, np.inf))
        high = np.maximum(own_high, np.where(by_center, f.center_z + center_error, -np.inf))
        ends.append((low, high))
    return ends[0], ends[1]


def _choices(
    pairs: Pairs, f: Fragments, may: _States, settings: RenderSettings, tolerance: float
) -> tuple[Choices, Array, tuple[Array, Array]]:
    """Return each pair's choices, (P,) bool for pixels covered in any case, and (P,) bounds of the pixels' depth."""
    (hit_low, hit_high), (low, high) = _depths(f, may, tolerance)
    hit_low, sure_high = np.where(may.hit_possible, hit_low, np.inf), np.where(may.hit_sure, hit_high, np.inf)
    depth = pairs.least(hit_low), pairs.least(sure_high)
    z_low, z_high = (end[pairs.run] for end in depth)
    # A splat that is in front of all others in any case sets depth(p) itself, so it passes the epsilon test.
    is_first = hit_low == z_low
    second = pairs.least(np.where(is_first, np.inf, hit_low))[pairs.run]
    alone = pairs.total(is_first.astype(np.int64))[pairs.run] == 1
    slack = 2 * tolerance * UNIT * f.tolerance
    before: Any = np.less if f.strict else np.less_equal
    passes = np.ones(len(z_low), bool)
    if f.strict:  # it passes unless epsilon vanishes in depth(p) + epsilon
        farthest = np.maximum(np.abs(z_low), np.abs(z_high)) + f.tolerance
        passes = f.tolerance - slack > tolerance * UNIT * farthest
    front = may.hit_sure & may.drawn_sure & is_first & alone & (hit_high < second) & passes
    at_front = may.filter_possible & ~may.disc_sure & (f.filter_depth == "front")  # its z may be depth(p) itself
    accepted = before(high, z_low + f.tolerance - slack) & (passes | ~at_front)
    sure = (may.drawn_sure | may.filter_sure) & accepted | front
    accepted = before(low, z_high + f.tolerance + slack) | at_front
    possible = (may.drawn_possible | may.filter_possible) & accepted
    weight_low, weight_high = _pair_weights(f, may, settings, tolerance)
    may_be_front = may.hit_possible & (hit_low <= z_high)
    choices = Choices(sure, possible & (weight_high > 0), weight_low, weight_high)
    drawn_if_hit = may.drawn_sure | (f.drawn is f.hit)
    certain = pairs.least(np.where(may_be_front, np.where(drawn_if_hit, weight_low, 0.0), np.inf)) > 0
    covered = np.isfinite(depth[1]) & certain & passes[pairs.first] | (pairs.total(np.where(sure, weight_low, 0.0)) > 0)
    return choices, covered, depth


def _pair_weights(f: Fragments, may: _States, settings: RenderSettings, tolerance: float) -> tuple[Array, Array]:
    """Return the (K,) least and greatest weight of each fragment, if it exists."""
    error, filter_error = tolerance * UNIT * f.drawn.scale_r, tolerance * UNIT * f.filter.scale_r
    r, r2 = f.drawn.r, f.filter.r
    r_low = np.minimum(
        np.where(may.drawn_possible, r - error, 1.0), np.where(may.filter_possible, r2 - filter_error, 1.0)
    )
    r_high = np.minimum(np.where(may.drawn_sure, r + error, 1.0), np.where(may.filter_sure, r2 + filter_error, 1.0))
    r_low, r_high = np.clip(r_low, 0.0, 1.0), np.clip(r_high, 0.0, 1.0)
    if settings.kernel == "table":
        low, high = _table_range(settings, r_low, r_high)
    else:
        low, high = kernel_weight(r_high**2, settings), kernel_weight(r_low**2, settings)
    rounding = tolerance * UNIT * (1 + settings.cutoff**2 / 2 + f.scale_factor)
    return low * f.factor * np.maximum(1 - rounding, 0.0), high * np.minimum(f.factor * (1 + rounding), 1 + rounding)


def _normals(
    pairs: Pairs,
    f: Fragments,
    may: _States,
    projected: ProjectedSplats,
    settings: RenderSettings,
    tolerance: float,
) -> tuple[Array, Array]:
    """Return (K, 3) bounds of each fragment's normal or field normal, of either sign where its facing is uncertain."""
    low = high = projected.normal_eye[pairs.splat]
    if settings.normals == "field":
        low, high = _field(pairs, f, may, projected, tolerance)
    unsure = (np.abs(projected.facing_margin) <= tolerance)[pairs.splat, None]
    return np.where(unsure, np.minimum(low, -high), low), np.where(unsure, np.maximum(high, -low), high)


def _field(
    pairs: Pairs, f: Fragments, may: _States, projected: ProjectedSplats, tolerance: float
) -> tuple[Array, Array]:
    """Return (K, 3) bounds of field normals; they include the center's normal where the ray may miss the disc."""
    normal, along_u, along_v = (a[pairs.splat] for a in (projected.normal_eye, projected.field_u, projected.field_v))
    possible, sure = may.disc_possible[:, None], may.disc_sure[:, None]
    u, v, scale = (np.where(possible, a[:, None], 0.0) for a in (f.disc.u, f.disc.v, f.disc.scale_r))
    size = np.abs(along_u) + np.abs(along_v)
    error = tolerance * UNIT * (scale * size + 4 * (np.abs(normal) + size))
    middle = normal + u * along_u + v * along_v
    low, high = normalized(middle - error, middle + error)
    low, high = np.where(possible, low, np.inf), np.where(possible, high, -np.inf)
    return np.where(sure, low, np.minimum(low, normal)), np.where(sure, high, np.maximum(high, normal))


def _table_range(settings: RenderSettings, r_low: Array, r_high: Array) -> tuple[Array, Array]:
    """Return the (K,) least and greatest weight of a kernel table between two radii.

    They are the extremes of the ends and of all samples between. Two overlapping runs, each of a power of two samples,
    cover those between.
    """
    table = np.array(settings.kernel_table)
    ends = kernel_weight(r_low**2, settings), kernel_weight(r_high**2, settings)
    low, high = np.minimum(*ends), np.maximum(*ends)
    rounding = 0.5 if settings.kernel_lookup == "nearest" else 0.0
    first = np.ceil(table_position(r_low**2, settings) - rounding).astype(np.int64)
    last = np.floor(table_position(r_high**2, settings) + rounding).astype(np.int64)
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


def _named(low: Array, high: Array, camera: Camera) -> dict[str, NDArray[np.float32]]:
    """Return the columns as AOVs, rounded outward to float32."""
    columns: dict[str, Any] = {"Z": 0, "weight": 1, "albedo": slice(2, 5), "N": slice(5, 8)}
    result = {}
    for name, column in columns.items():
        for suffix, values, outward in (("lo", low, -np.inf), ("hi", high, np.inf)):
            exact = values[:, column]
            rounded = exact.astype(np.float32)
            wrong = rounded > exact if suffix == "lo" else rounded < exact
            rounded = np.where(wrong, np.nextafter(rounded, np.float32(outward)), rounded)
            result[f"{name}.{suffix}"] = rounded.reshape(camera.height, camera.width, *exact.shape[1:])
    return result
