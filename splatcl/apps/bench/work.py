"""The bytes and the operations that each pass needs, and its distance to the limits of the machine.

Bytes are those of the pass's input and output, once each. Operations are counted in the kernels' source.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from splatcl.apps.bench.measure import Result
from splatcl.apps.bench.passes import PASSES
from splatcl.apps.bench.roofline import Limits
from splatcl.scene.settings import RenderSettings

FLOPS = {
    # passes/bin.cl. Each splat: center and tangents rotated 45, translated 3, error 4, depth range 8.
    "splat": 60,
    # Each splat if back faces are culled: g 9, |t_u||t_v| 5, g.c 5, tolerance 6.
    "culled splat": 25,
    # Each listed splat: in front 1, half width and height 8, depths 2, ranges of pixels 2 x 30 and 1 / z 1, whole
    # pixels 12, tiles 4.
    "listed": 88,
    # Each listed splat if there are layers, for its least depth: g 9, five products 25, thresholds 5, depth 9.
    "layered": 48,
    # passes/project.cl. Each projected entry: center in twice the precision 3 x 69 (three exact products of 11, three
    # exact sums of 6, 12 for the low words, a last sum of 6), two tangents rotated 30, cross product 9, reach 4, unit
    # normal and facing 15, distance 6, choice of the reference 5, reference point 2 x 64 (two_divide 25, two_multiply
    # 21, two_add 14, rounding 4), coefficients 40, extents 42, slack 5, bounds of disc and pre-filter 16, their pixels
    # 50, least depth 9, words of the boxes 8. The few splats in twice the precision throughout cost more.
    "entry": 574,
    # passes/tile.h, in both raster passes. Each rasterized entry: its box 15.
    "taken": 15,
    # passes/visibility.cl, splat/disc.h. Each lane: position 2, offsets 4, u and v 8, den 4, u^2 + v^2 <= den^2 4.
    "tested lane": 22,
    # Each disc hit: 1 / den, z.
    "hit": 2,
    # passes/attributes.cl, splat/fragment.h. Each lane: as above, position 2 more, 1 / den, z, r3^2 2.
    "filtered lane": 28,
    # Each lane with the pre-filter: r2^2 6 more.
    "prefiltered lane": 34,
    # Each accepted fragment: weight 23 (exp: reduction 7, seven steps of 2, scaling 1, argument 1), sums 16.
    "fragment": 39,
    # passes/shade.cl, shading/surface.h. Each pixel: ray 6, mean depth 1, position 3, direction 10, albedo 3,
    # normal 10.
    "pixel": 33,
    # shading/shaders/phong.h. Each pixel: ambient.
    "ambient": 3,
    # Each light: direction 13, N.L 5, diffuse 10, mirrored 7, R.V 5, power 43 (logarithm 20, exponent 1, exp 22),
    # specular 7.
    "light": 90,
    # shading/shaders/npr.h. Each pixel: nine differences of depths, N.V 5, positions in the tones 3, color 3.
    "npr": 20,
    # Each light: direction 13, N.L 5, sum 6.
    "npr light": 24,
    # shading/shaders/depth.h. Each pixel: a division.
    "depth": 1,
}
"""Operations of each item: + - * / and square root count 1; comparison, select, conversion and sign change count 0."""
GBUFFER = 9
"""Reals of a pixel that attributes writes or shade reads: weight, color 3, normal 3, depth sum, and count or depth."""
DEPTH_WRITES = 2
"""Words of a pixel that visibility writes: depth and id."""
COLOR_WRITES = 4
"""Reals of a pixel that shade writes: RGBA."""
ID_BYTES, BOX_BYTES = 4, 8


@dataclass(frozen=True)
class Work:
    """The bytes and the operations that one pass needs for one frame."""

    read_bytes: int
    written_bytes: int
    flops: int

    def limit_seconds(self, limits: Limits, settings: RenderSettings) -> tuple[float, str]:
        """Return the least possible time, seconds, and the resource that limits it: "memory" or "arithmetic"."""
        memory = self.read_bytes / limits.read + self.written_bytes / limits.write
        arithmetic = self.flops / limits.flops[settings.precision]
        return max((memory, "memory"), (arithmetic, "arithmetic"))


@dataclass(frozen=True)
class PassLimit:
    """The work of a pass and its limit; `lanes_used` is the share of lanes whose result counts, None without lanes."""

    work: Work
    limit_seconds: float
    bound: str
    share_of_limit: float
    lanes_used: float | None

    def as_json(self) -> dict[str, Any]:
        """Return all fields as JSON's types."""
        return {**vars(self.work), **{name: value for name, value in vars(self).items() if name != "work"}}


def work_of(result: Result) -> dict[str, Work]:
    """Return the work of each pass."""
    counts, image = result.counts, result.counts.num_pixels * result.counts.real_bytes
    record = counts.record_bytes + counts.attribute_bytes + BOX_BYTES
    touched = counts.num_listed * counts.touched_bytes
    return {
        "bin": Work(
            counts.num_splats * counts.plane_bytes + touched,
            touched + counts.num_entries * counts.entry_bytes,
            _bin_flops(result),
        ),
        "project": Work(
            counts.num_entries * counts.entry_bytes + counts.num_projected * counts.splat_bytes,
            counts.num_projected * record + counts.num_entries * 2 * counts.real_bytes,
            counts.num_projected * FLOPS["entry"],
        ),
        "visibility": Work(
            counts.num_entries * counts.real_bytes + counts.num_discs * (counts.record_bytes + ID_BYTES),
            image * DEPTH_WRITES,
            _visibility_flops(result),
        ),
        "attributes": Work(
            counts.num_entries * counts.real_bytes + counts.num_near * record + image,
            image * GBUFFER,
            _attributes_flops(result),
        ),
        "shade": Work(image * GBUFFER, image * COLOR_WRITES, _shade_flops(result)),
    }


def _bin_flops(result: Result) -> int:
    culled = result.facing == "cull"
    splat = FLOPS["splat"] + (FLOPS["culled splat"] if culled else 0)
    listed = FLOPS["listed"] + (0 if culled else FLOPS["layered"])
    return result.counts.num_splats * splat + result.counts.num_listed * listed


def _visibility_flops(result: Result) -> int:
    counts = result.counts
    lanes = counts.visibility_lanes * FLOPS["tested lane"]
    return counts.num_discs * FLOPS["taken"] + lanes + result.fragments.hits * FLOPS["hit"]


def _attributes_flops(result: Result) -> int:
    counts, prefilter = result.counts, result.row.settings.prefilter == "min"
    lanes = counts.attribute_lanes * FLOPS["prefiltered lane" if prefilter else "filtered lane"]
    return counts.num_near * FLOPS["taken"] + lanes + result.fragments.drawn.fragments * FLOPS["fragment"]


def _shade_flops(result: Result) -> int:
    settings, pixel = result.row.settings, FLOPS["pixel"]
    if settings.shader == "phong":
        pixel += FLOPS["ambient"] + len(settings.lights) * FLOPS["light"]
    elif settings.shader == "npr":
        pixel += FLOPS["npr"] + len(settings.lights) * FLOPS["npr light"]
    elif settings.shader == "depth":
        pixel += FLOPS["depth"]
    return result.fragments.drawn.pixels * pixel


def limits_of(result: Result, limits: Limits) -> dict[str, PassLimit]:
    """Compare the time of each pass with its limit."""
    used = lanes_used(result)
    found = {}
    for name, work in work_of(result).items():
        seconds, bound = work.limit_seconds(limits, result.row.settings)
        found[name] = PassLimit(work, seconds, bound, seconds / result.passes[name].median, used.get(name))
    assert tuple(found) == PASSES
    return found


def lanes_used(result: Result) -> dict[str, float]:
    """Return the share of evaluated lanes that hit a disc (visibility) or give a fragment (attributes)."""
    counts, fragments = result.counts, result.fragments
    return {
        "visibility": fragments.hits / max(counts.visibility_lanes, 1),
        "attributes": fragments.drawn.fragments / max(counts.attribute_lanes, 1),
    }
