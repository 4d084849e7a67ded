"""The visibility and the attribute pass: every splat against every pixel."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from splatcl.oracle.buffers import Array, ProjectedSplats
from splatcl.oracle.geometry.discs import Discs, Hits, intersect
from splatcl.oracle.geometry.ellipses import Coverage, Ellipses, cover
from splatcl.oracle.geometry.rays import OFFSET_ERROR, TINY, UNIT, to_raster
from splatcl.scene.camera import Camera
from splatcl.scene.settings import RenderSettings


@dataclass(frozen=True, eq=False)
class Fragments:
    """Every pixel of a chunk against every splat, (P, N) each."""

    r_squared: Array  # <= 1 where there is one
    z: Array
    scale_z: Array
    margin: Array  # unsigned, of all that this took
    disc: Array  # bool: the ray meets the disc itself
    u: Array
    v: Array


@dataclass(frozen=True, eq=False)
class Footprints:
    """What the two passes share: splats against pixels, whatever the footprint."""

    projected: ProjectedSplats
    camera: Camera
    settings: RenderSettings
    discs: Discs
    ellipses: Ellipses | None

    @classmethod
    def of(
        cls,
        projected: ProjectedSplats,
        camera: Camera,
        settings: RenderSettings,
        offset_error: float = OFFSET_ERROR,
    ) -> Footprints:
        """Prepare the footprints of all splats; `offset_error` as in `Discs`."""
        discs = replace(Discs.of(projected, camera), offset_error=offset_error)
        raycast = settings.footprint == "raycast"
        return cls(
            projected, camera, settings, discs, None if raycast else Ellipses.of(projected, discs, camera, settings)
        )

    def coverage(self, hits: Hits, s: Array, filtered: bool) -> Coverage:
        """Say where the footprint is, within its clip lines; of an ellipse, `filtered` by EWA or not."""
        if self.ellipses is None:
            return Coverage(hits.r_squared, hits.r, hits.scale_r, hits.margin)
        return _cut(cover(self.ellipses, filtered, self.camera, s), hits.kept, hits.kept_margin)

    def prefilter(self, hits: Hits, s: Array) -> Coverage:
        """Say where the pre-filter of [BHZK05] is, within the clip lines."""
        return _cut(_prefilter(self.projected, self.camera, self.settings, s), hits.kept, hits.kept_margin)

    def visibility_fragments(self, s: Array) -> Fragments:
        """Return the fragments of the visibility pass, which knows no pre-filter."""
        hits = intersect(self.discs, self.camera, s)
        return self._fragments(hits, self.coverage(hits, s, filtered=False))

    def attribute_fragments(self, s: Array) -> Fragments:
        """Return the fragments of the attribute pass."""
        hits = intersect(self.discs, self.camera, s)
        footprint = self.coverage(hits, s, filtered=True)
        return self._fragments(hits, footprint, self.prefilter(hits, s) if self.settings.prefilter == "min" else None)

    def _fragments(self, hits: Hits, footprint: Coverage, prefilter: Coverage | None = None) -> Fragments:
        """Join what covers a pixel; a fragment whose ray misses the disc takes the centre's depth."""
        r_squared, margin = footprint.r_squared, np.abs(footprint.margin)
        if prefilter is not None:
            margin = np.minimum(margin, np.where(r_squared <= 1, np.inf, np.abs(prefilter.margin)))
            r_squared = np.minimum(r_squared, prefilter.r_squared)
        if self.ellipses is not None:
            margin = np.minimum(margin, np.where(r_squared <= 1, np.abs(hits.margin), np.inf))
        disc, center_z = hits.r_squared <= 1, self.projected.center_eye[:, 2]
        z = np.where(disc, hits.z, center_z)
        scale_z = np.where(disc, hits.scale_z, np.abs(center_z) + TINY)
        return Fragments(r_squared, z, scale_z, margin, disc, hits.u, hits.v)

    def weight(self, f: Fragments) -> Array:
        """(P, N) weights where r^2 <= 1, 0 elsewhere."""
        weight, exists = np.zeros(f.r_squared.shape), f.r_squared <= 1
        weight[exists] = kernel_weight(f.r_squared[exists], self.settings)
        if self.ellipses is not None and self.settings.prefilter == "ewa":
            weight *= self.ellipses.factor
        return weight


def _cut(cover: Coverage, kept: Array, margin: Array) -> Coverage:
    """Return what clip lines leave."""
    r_squared = np.where(kept, cover.r_squared, np.inf)
    return replace(cover, r_squared=r_squared, margin=np.fmin(cover.margin, margin))


def _prefilter(projected: ProjectedSplats, camera: Camera, settings: RenderSettings, s: Array) -> Coverage:
    """r2^2 = |p - p_c|^2 / prefilter_radius^2, +inf for no pre-filter. `s` as for `intersect`."""
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
    """Weight at r^2 <= 1."""
    if settings.kernel == "constant":
        return np.ones(r_squared.shape)
    if settings.kernel == "gaussian":
        return np.exp(-(settings.cutoff**2) * r_squared / 2)
    table = np.asarray(settings.kernel_table)
    position = np.sqrt(r_squared) * (len(table) - 1)
    if settings.kernel_lookup == "nearest":
        return table[np.floor(position + 0.5).astype(np.int64)]
    return np.interp(position, np.arange(len(table)), table)
