"""How many bytes each pass must move and how many operations it must do, and how near it is to that limit.

Bytes are those of the pass' own input and output, once each. Operations are counted from the kernels' source.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from splatcl.bench.measure import Result
from splatcl.bench.passes import PASSES
from splatcl.bench.roofline import Limits
from splatcl.settings import RenderSettings

FLOPS = {
    # project.cl. Each splat: centre to twice the precision 3 x 69 (three exact products of 11, three exact sums of 6,
    # 12 for the low words, a last sum of 6), two tangents rotated 30, their cross product 9, reach 4, unit normal and
    # facing 15, distance 6.
    "splat": 271,
    # Those that survive: reference point 2 x 64 (two_divide 25, two_multiply 21, two_add 14, rounding 4),
    # coefficients 40, bounds 68, choice of the reference 5, slack and clamping 9.
    "survivor": 250,
    # visibility.cl, splat.h. Each lane of a block that a record's bounds touch: offsets 4, u and v 8, den 4,
    # u^2 + v^2 <= den^2 4.
    "tested lane": 20,
    # Each disc hit: 1 / den, z.
    "hit": 2,
    # attributes.cl, fragment.h. Each lane as above, then 1 / den, z, r3^2 2 ...
    "filtered lane": 24,
    # ... and with the pre-filter r2^2.
    "prefiltered lane": 30,
    # Each accepted fragment: weight 23 (exp: reduction 7, seven steps of 2, scaling 1, argument 1), sums 15.
    "fragment": 38,
    # shade.cl, surface.h. Each pixel: ray 6, mean depth 1, position 3, distance 7, direction 13, albedo 3, normal 10.
    "pixel": 43,
    # phong.h. Each light: direction 13, N.L 5, diffuse 10, mirrored 10, R.V 5, power 45 (logarithm 22, exp 23),
    # specular 7.
    "light": 95,
}
"""+ - * / and square roots, one each; comparisons, selects and conversions are none."""
GBUFFER_READS, GBUFFER_WRITES = 9, 10
"""Reals of a pixel that shade reads (depth, weight, colour 3, normal 3, depth sum); attributes writes a count too."""
DEPTH_WRITES = 2
"""Depth and id."""
COLOR_WRITES = 4


@dataclass(frozen=True)
class Work:
    """What one pass must do in one frame."""

    read_bytes: int
    written_bytes: int
    flops: int

    def limit_seconds(self, limits: Limits, settings: RenderSettings) -> tuple[float, str]:
        """Return the least time that this can take, and whether "memory" or "arithmetic" sets it."""
        memory = self.read_bytes / limits.read + self.written_bytes / limits.write
        arithmetic = self.flops / limits.flops[settings.precision]
        return max((memory, "memory"), (arithmetic, "arithmetic"))


@dataclass(frozen=True)
class PassLimit:
    """A pass against its own limit. `lanes_used` is the share of lanes whose result counted, None where it has none."""

    work: Work
    limit_seconds: float
    bound: str
    share_of_limit: float
    lanes_used: float | None

    def as_json(self) -> dict[str, Any]:
        """Return everything."""
        return {**vars(self.work), **{name: value for name, value in vars(self).items() if name != "work"}}


def work_of(result: Result) -> dict[str, Work]:
    """Return the work of each pass."""
    counts, fragments, settings = result.counts, result.fragments, result.row.settings
    image = counts.num_pixels * counts.real_bytes
    record = counts.record_bytes + counts.attribute_bytes
    lane = FLOPS["prefiltered lane" if settings.prefilter == "min" else "filtered lane"]
    lights = len(settings.lights) if settings.shader == "phong" else 0
    return {
        "project": Work(
            counts.num_splats * counts.splat_bytes + counts.num_survivors * counts.color_bytes,
            counts.num_survivors * record,
            counts.num_splats * FLOPS["splat"] + counts.num_survivors * FLOPS["survivor"],
        ),
        "bin": Work(counts.num_survivors * record, counts.num_records * record, 0),
        "visibility": Work(
            counts.num_records * counts.record_bytes,
            image * DEPTH_WRITES,
            counts.num_lanes * FLOPS["tested lane"] + fragments.hits * FLOPS["hit"],
        ),
        "attributes": Work(
            counts.num_records * record + image,
            image * GBUFFER_WRITES,
            counts.num_lanes * lane + fragments.drawn.fragments * FLOPS["fragment"],
        ),
        "shade": Work(
            image * GBUFFER_READS,
            image * COLOR_WRITES,
            fragments.drawn.pixels * (FLOPS["pixel"] + lights * FLOPS["light"]),
        ),
    }


def limits_of(result: Result, limits: Limits) -> dict[str, PassLimit]:
    """Return how near each pass comes to its own limit."""
    used = lanes_used(result)
    found = {}
    for name, work in work_of(result).items():
        seconds, bound = work.limit_seconds(limits, result.row.settings)
        found[name] = PassLimit(work, seconds, bound, seconds / result.passes[name].median, used.get(name))
    assert tuple(found) == PASSES
    return found


def lanes_used(result: Result) -> dict[str, float]:
    """Return the share of evaluated lanes that hit a disc (visibility) or were accumulated (attributes)."""
    lanes = max(result.counts.num_lanes, 1)
    return {"visibility": result.fragments.hits / lanes, "attributes": result.fragments.drawn.fragments / lanes}
