"""Fragments: the pixels that a splat covers, whatever its footprint, and their weights."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from splatcl.oracle.buffers import Array, ProjectedSplats
from splatcl.oracle.geometry.discs import Discs, Hits, intersect
from splatcl.oracle.geometry.ellipses import Coverage, Ellipses, cover
from splatcl.oracle.geometry.points import point_half
from splatcl.oracle.geometry.rays import OFFSET_ERROR, TINY, UNIT, range_margin, to_image_plane, to_raster
from splatcl.scene.camera import Camera
from splatcl.scene.settings import RenderSettings


@dataclass(frozen=True, eq=False)
class Fragments:
    """P pixels against N splats: arrays are (P, N)."""

    r_squared: Array  # r^2; there is a fragment where it is <= 1
    z: Array  # eye z, scene units
    scale_z: Array  # rounding error of z, 2^-24 scene units
    margin: Array  # unsigned, least of the decisions that made the fragment
    on_disc: Array  # bool: the ray meets the disc itself
    at_front: Array  # bool: z is depth(p) itself, under filter_depth="front"
    u: Array  # disc coordinates of the ray's point on the splat's plane
    v: Array


@dataclass(frozen=True, eq=False)
class Footprints:
    """Footprints of N splats, for the visibility and the attribute pass."""

    projected: ProjectedSplats
    camera: Camera
    settings: RenderSettings
    discs: Discs
    ellipses: Ellipses | None  # None under footprint="raycast"

    @classmethod
    def of(
        cls, projected: ProjectedSplats, camera: Camera, settings: RenderSettings, offset_error: float = OFFSET_ERROR
    ) -> Footprints:
        """Prepare the footprints; `offset_error` as in `Discs`."""
        discs = replace(Discs.of(projected, camera), offset_error=offset_error)
        raycast = settings.footprint == "raycast"
        ellipses = None if raycast else Ellipses.of(projected, discs, camera, settings)
        return cls(projected, camera, settings, discs, ellipses)

    def coverage(self, hits: Hits, s: Array, filtered: bool) -> Coverage:
        """Evaluate the footprint within its clip lines; an ellipse is widened by the low-pass filter if `filtered`."""
        if self.ellipses is None:
            covered = Coverage(hits.r_squared, hits.r, hits.scale_r, hits.margin)
            return self._in_sprite(covered, s, filtered)
        return _cut(cover(self.ellipses, filtered, self.camera, s), hits.kept, hits.kept_margin)

    def prefilter(self, hits: Hits, s: Array) -> Coverage:
        """Evaluate the pre-filter "min" ([BHZK05] section 5) within the clip lines."""
        kept = _cut(_prefilter(self.projected, self.camera, self.settings, s), hits.kept, hits.kept_margin)
        return self._in_sprite(kept, s, filtered=True)

    def _in_sprite(self, coverage: Coverage, s: Array, filtered: bool) -> Coverage:
        """Remove the pixels outside the square point, which the filter enlarges if `filtered` ([BHZK05] section 3)."""
        if self.settings.sprite == "exact":
            return coverage
        center = self.projected.center_eye
        tangents = self.projected.tangent_u_eye, self.projected.tangent_v_eye
        half = point_half(*tangents, center[:, 2], self.camera, self.settings, filtered)
        with np.errstate(invalid="ignore"):
            off = np.abs(to_raster(s, self.camera) - to_raster(to_image_plane(center, self.camera), self.camera))
            distance = off.max(axis=-1)
            margin = (half - distance) / (UNIT * (4 * half + distance + self.discs.offset_error))
        in_range = range_margin(center[:, 2], np.abs(center[:, 2]) + TINY, self.camera)
        margin = np.where(in_range < 0, np.fmin(in_range, -TINY), np.fmin(margin, in_range))
        return _cut(coverage, margin >= 0, margin)

    def visibility_fragments(self, s: Array) -> Fragments:
        """Return the fragments of the visibility pass, which takes no pre-filter and no low-pass filter."""
        hits = intersect(self.discs, self.camera, s)
        return self._fragments(hits, self.coverage(hits, s, filtered=False))

    def attribute_fragments(self, s: Array, depth: Array) -> Fragments:
        """Return the fragments of the attribute pass, r^2 = min(r3^2, r2^2) under the pre-filter "min".

        `depth` (P, 1) is depth(p), for filter_depth="front".
        """
        hits = intersect(self.discs, self.camera, s)
        footprint = self.coverage(hits, s, filtered=True)
        if self.settings.prefilter != "min":
            return self._fragments(hits, footprint)
        prefilter = self.prefilter(hits, s)
        by_filter = ~((footprint.r_squared <= 1) | (hits.r_squared <= 1)) & (prefilter.r_squared <= 1)
        return self._with_filter_depth(self._fragments(hits, footprint, prefilter), hits, by_filter, depth)

    def _with_filter_depth(self, f: Fragments, hits: Hits, by_filter: Array, depth: Array) -> Fragments:
        """Give the fragments of the pre-filter alone, (P, N) bool `by_filter`, the depth of `filter_depth`."""
        if self.settings.filter_depth == "plane":
            on_plane = by_filter & (hits.plane_margin >= 0)
            margin = np.fmin(f.margin, np.where(by_filter, np.abs(hits.plane_margin), np.inf))
            z, scale_z = np.where(on_plane, hits.z, f.z), np.where(on_plane, hits.scale_z, f.scale_z)
            return replace(f, z=z, scale_z=scale_z, margin=margin)
        if self.settings.filter_depth == "front":
            at_front = by_filter & np.isfinite(depth)
            return replace(f, z=np.where(at_front, depth, f.z), at_front=at_front)
        return f

    def _fragments(self, hits: Hits, footprint: Coverage, prefilter: Coverage | None = None) -> Fragments:
        """Join footprint and pre-filter; a fragment whose ray misses the disc takes the depth of the splat's center."""
        r_squared, margin = footprint.r_squared, np.abs(footprint.margin)
        if prefilter is not None:
            margin = np.minimum(margin, np.where(r_squared <= 1, np.inf, np.abs(prefilter.margin)))
            r_squared = np.minimum(r_squared, prefilter.r_squared)
        if self.ellipses is not None:
            margin = np.minimum(margin, np.where(r_squared <= 1, np.abs(hits.margin), np.inf))
        on_disc, center_z = hits.r_squared <= 1, self.projected.center_eye[:, 2]
        z = np.where(on_disc, hits.z, center_z)
        scale_z = np.where(on_disc, hits.scale_z, np.abs(center_z) + TINY)
        return Fragments(r_squared, z, scale_z, margin, on_disc, np.zeros(z.shape, bool), hits.u, hits.v)

    def weight(self, f: Fragments) -> Array:
        """Return the weights (P, N) of fragments, EWA's factor included; 0 where there is no fragment."""
        weight, exists = np.zeros(f.r_squared.shape), f.r_squared <= 1
        weight[exists] = kernel_weight(f.r_squared[exists], self.settings)
        if self.ellipses is not None and self.settings.prefilter == "ewa":
            weight *= self.ellipses.factor
        return weight


def _cut(coverage: Coverage, kept: Array, kept_margin: Array) -> Coverage:
    """Remove the pixels that the clip lines do not keep."""
    r_squared = np.where(kept, coverage.r_squared, np.inf)
    return replace(coverage, r_squared=r_squared, margin=np.fmin(coverage.margin, kept_margin))


def _prefilter(projected: ProjectedSplats, camera: Camera, settings: RenderSettings, s: Array) -> Coverage:
    """Evaluate r2^2 = |p - p_c|^2 / prefilter_radius^2, +inf without a pre-filter; `s` as for `intersect`."""
    radius, error = settings.prefilter_radius, projected.prefilter_error
    p = to_raster(s, camera)
    x, y = projected.prefilter_point.T
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        r_squared = ((p[..., 0] - x) ** 2 + (p[..., 1] - y) ** 2) / radius**2
        r = np.sqrt(r_squared)
        scale = 2 * r_squared + 4 * r * error / radius
        margin = np.fmin((1 - r_squared) / (UNIT * scale), projected.facing_margin)
    present = (projected.prefilter_margin >= 0) & ~projected.culled
    margin = np.fmin(margin, projected.prefilter_margin)
    return Coverage(np.where(present, r_squared, np.inf), r, r + 2 * error / radius, margin)


def kernel_weight(r_squared: Array, settings: RenderSettings) -> Array:
    """Return the weights (...) at r^2 (...) <= 1: exp(-cutoff^2 r^2 / 2), 1, or the table's sample."""
    if settings.kernel == "constant":
        return np.ones(r_squared.shape)
    if settings.kernel == "gaussian":
        return np.exp(-(settings.cutoff**2) * r_squared / 2)
    table, position = np.asarray(settings.kernel_table), table_position(r_squared, settings)
    if settings.kernel_lookup == "nearest":
        return table[np.floor(position + 0.5).astype(np.int64)]
    return np.interp(position, np.arange(len(table)), table)


def table_position(r_squared: Array, settings: RenderSettings) -> Array:
    """Return the positions (...) in the kernel table at r^2 (...) <= 1, in samples from the first, 0 to n - 1.

    Texel k of a texture of n texels has its center at (k + 1/2) / n, and the ends are clamped.
    """
    n = len(settings.kernel_table)
    t = r_squared if settings.table_over == "r2" else np.sqrt(r_squared)
    return np.clip(n * t - 0.5, 0, n - 1) if settings.table_addressing == "texture" else t * (n - 1)
