"""Conservation: what goes into a render and what comes out of it must add up, exactly (docs/probe.md)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splatcl import oracle, pipeline
from splatcl.aovs import DeviceAovs
from splatcl.camera import Camera
from splatcl.frame import Frame
from splatcl.passes import Passes
from splatcl.pipeline import DepthBuffer, ProjectedSplats, TileLists
from splatcl.render import Renderer, Resident
from splatcl.resident import ResidentSplats
from splatcl.settings import RenderSettings, Target
from splatcl.splats import Splats

Array = NDArray[Any]
CONSTANT_COLOR = (1.0, 0.7, 1 / 3)
"""Red must come out as it is; the others to within the rounding of their sums."""
SUSPECTS = 100
"""Splats that should not have been left out are drawn by the oracle, one by one; of more this many are."""
BEYOND_DOUBT = 32.0
"""Margin, in rounding errors, from which a float32 renderer decides as the oracle does (tests/tolerances.py)."""
SPLATS_AT_ONCE = 1 << 18
TARGET_TYPES = {"float16": np.float16, "float32": np.float32}
ONE_LANE: dict[str, Any] = {"LANES": 1, "SHADING": 0, "FIELD": 0, "CHANNELS": 0, "SHADER": '"shading/shaders/albedo.h"'}
"""Build options of kernels that take a splat and a pixel at a time, and only ask whether there is a fragment."""
CHUNK = 4096
"""Records whose fragments a work-item counts."""


@dataclass(frozen=True)
class Check:
    """One thing that must add up, and the numbers that say whether it did."""

    name: str
    passed: bool
    detail: str

    @property
    def verdict(self) -> str:
        """What is recorded of it."""
        return f"{'passed' if self.passed else 'FAILED'}: {self.detail}"

    def __str__(self) -> str:
        return f"{self.name:<15} {self.verdict}"


def check(frame: Frame) -> tuple[Check, ...]:
    """Render the frame's splats again and account for them; see `Frame.check`."""
    renderer, splats = frame.origin("check")
    resident = renderer.resident(splats)
    survivors, checks, again = renderer.call(_account, resident, frame.camera, frame.settings)
    checks = [_check_splats(survivors, resident.splats, frame.camera, frame.settings), *checks]
    differing = [name for name, array in again.items() if array.tobytes() != frame[name].tobytes()]
    detail = f"{', '.join(differing or again)} {'differ from' if differing else 'have'} the bits of the first render"
    checks.append(Check("repetition", not differing, detail))
    frame.metadata["checks"] = {one.name: one.verdict for one in checks}
    return tuple(checks)


def _account(
    renderer: Renderer, resident: Resident, camera: Camera, settings: RenderSettings
) -> tuple[Array, list[Check], dict[str, Array]]:
    """Render with a constant colour.

    Returns
    -------
    survivors : (S,) uint32
        The splats that the projection kept.
    checks : list of Check
        Those of the binning, the fragments and the colour.
    again : dict of str to array
        The AOVs that no colour enters.
    """
    settings = replace(settings, shading="deferred", shader="albedo", user_shader="")
    white = replace(resident.splats, color=np.tile(CONSTANT_COLOR, (len(resident.splats), 1)))
    passes, on_device = renderer.prepare(renderer.upload(white), camera, settings)
    view, epsilon = passes.view(on_device.origin), resident.epsilon(settings)
    kept = _project_in_order(passes, view, on_device)
    copies = _expected_copies(kept, passes.tile_size, passes.tiles_x)
    depth, gbuffer = pipeline.frame_buffers(passes)
    faults: list[str] = []
    num_listed = 0
    for lists in pipeline.bin(passes, view, on_device):
        projected = pipeline.project(passes, view, on_device, lists)
        faults += _list_faults(passes, kept, copies, lists, projected)
        num_listed += int(lists.begin[-1])
        pipeline.visibility(passes, lists, projected, depth)
        pipeline.attributes(passes, view, lists, projected, depth, epsilon, gbuffer)
    aovs = DeviceAovs(passes, view, depth, gbuffer, None)
    num_fragments = _count_fragments(passes, view, on_device, depth, epsilon)
    checks = [
        _check_binning(faults, len(copies.tile), num_listed, passes.num_tiles),
        _check_fragments(num_fragments, aovs["count"]),
        _check_color(aovs["albedo"], aovs["weight"], aovs["count"], settings.target),
    ]
    return kept.ids, checks, {name: aovs[name] for name in ("Z", "particleid", "weight", "count")}


# ---- splats: each is drawn, culled or beside the image


def _check_splats(survivors: Array, splats: Splats, camera: Camera, settings: RenderSettings) -> Check:
    """Check that no splat was lost: the oracle must agree that those not kept are culled or touch no pixel."""
    num_culled = num_outside = num_lost = 0
    left_out = np.setdiff1d(np.arange(len(splats)), survivors)
    for start in range(0, len(left_out), SPLATS_AT_ONCE):
        part = splats.take(left_out[start : start + SPLATS_AT_ONCE])
        projected = oracle.project(part, camera, settings)
        first, last = np.ceil(projected.bounds[:, :2] - 0.5), np.floor(projected.bounds[:, 2:] - 0.5)
        size = np.array([camera.width, camera.height])
        touches = (np.maximum(first, 0) <= np.minimum(last, size - 1)).all(axis=1)
        suspects = np.flatnonzero(touches)
        lost = sum(_is_drawn(part.take([i]), camera, settings) for i in suspects[:SUSPECTS])
        lost += max(len(suspects) - SUSPECTS, 0)
        culled = int(np.count_nonzero(projected.culled))
        num_culled, num_lost = num_culled + culled, num_lost + lost
        num_outside += len(part) - culled - lost
    increasing = bool((np.diff(survivors.astype(np.int64)) > 0).all())
    added_up = len(survivors) + num_culled + num_outside + num_lost == len(splats)
    detail = f"{len(survivors)} drawn + {num_culled} culled + {num_outside} that touch no pixel = {len(splats)}"
    if splats.num_dropped:
        detail += f", after {splats.num_dropped} invalid ones were dropped"
    if num_lost:
        detail += f", and {num_lost} lost"
    if not increasing:
        detail += "; they are not in splat order"
    return Check("splats", increasing and added_up and not num_lost, detail)


def _is_drawn(splat: Splats, camera: Camera, settings: RenderSettings) -> bool:
    """Whether the oracle draws a single splat at some pixel beyond doubt."""
    projected = oracle.project(splat, camera, settings)
    depth = oracle.visibility(projected, camera, settings)
    gbuffer = oracle.attributes(projected, depth, camera, settings, 0.0, splat.color)
    margin = np.minimum(depth.margin, gbuffer.margin)
    return bool(((gbuffer.count > 0) & (margin > BEYOND_DOUBT)).any())


# ---- binning: each splat is in the list of each tile that its bounds touch


@dataclass(frozen=True)
class _Projected:
    """Survivors in splat order."""

    ids: Array  # (S,) uint32
    records: Array  # (S,) ProjectedSplat
    attributes: Array  # (S,) SplatAttributes
    boxes: Array  # (S, 4) int16 x_min, y_min, x_max, y_max

    @classmethod
    def read(cls, passes: Passes, lists: TileLists, projected: ProjectedSplats) -> _Projected:
        """Read what was made of each entry of the lists."""
        device, dtypes, num = passes.device, passes.dtypes, int(lists.begin[-1])
        ids = device.read(lists.ids, (lists.start + num,), np.uint32)[lists.start :]
        records = device.read(projected.records, (num,), dtypes["ProjectedSplat"])
        attributes = device.read(projected.attributes, (num,), dtypes["SplatAttributes"])
        return cls(ids, records, attributes, device.read(projected.boxes, (num, 4), np.int16))

    def take(self, where: Array) -> _Projected:
        """Return those at indices or of a mask."""
        return _Projected(*(getattr(self, field.name)[where] for field in fields(self)))


@dataclass(frozen=True)
class _Copies:
    """The entries that there must be, by tile and then by splat."""

    tile: Array  # (C,)
    survivor: Array  # (C,) index of the survivor


def _project_in_order(passes: Passes, view: Any, splats: ResidentSplats) -> _Projected:
    """Project every splat, without tiles, and return those that touch a pixel."""
    parts = []
    for lists in pipeline.in_order(passes, splats.num_splats):
        part = _Projected.read(passes, lists, pipeline.project(passes, view, splats, lists))
        parts.append(part.take(part.boxes[:, 0] <= part.boxes[:, 2]))
    return _Projected(*(np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(_Projected)))


def _expected_copies(kept: _Projected, tile_size: int, tiles_x: int) -> _Copies:
    x, y, x_last, y_last = (kept.boxes // tile_size).astype(np.int64).T
    across = x_last - x + 1
    num_copies = across * (y_last - y + 1)
    survivor = np.repeat(np.arange(len(num_copies)), num_copies)
    nth = np.arange(len(survivor)) - np.repeat(np.cumsum(num_copies) - num_copies, num_copies)
    tile = (y[survivor] + nth // across[survivor]) * tiles_x + x[survivor] + nth % across[survivor]
    order = np.argsort(tile, kind="stable")
    return _Copies(tile[order], survivor[order])


def _list_faults(
    passes: Passes, kept: _Projected, copies: _Copies, lists: TileLists, projected: ProjectedSplats
) -> Iterator[str]:
    """Yield what is wrong with a band's lists: their order, what they lack, or the records made of them."""
    got = _Projected.read(passes, lists, projected)
    tile = np.repeat(np.arange(lists.first_tile, lists.last_tile), np.diff(lists.begin))
    place = (tile.astype(np.int64) << 32) + got.ids
    ends = np.searchsorted(copies.tile, (lists.first_tile, lists.last_tile))
    tile, survivor = copies.tile[slice(*ends)], copies.survivor[slice(*ends)]
    wanted = (tile.astype(np.int64) << 32) + kept.ids[survivor]
    if not (np.diff(place) > 0).all():
        yield f"order in tiles {lists.first_tile} to {lists.last_tile - 1}"
        return
    at = np.minimum(np.searchsorted(place, wanted), max(len(place) - 1, 0))
    missing = place[at] != wanted if len(place) else np.ones(len(wanted), bool)
    if missing.any():
        yield f"{np.count_nonzero(missing)} splats not listed, the first in tile {tile[int(missing.argmax())]}"
        return
    expected, got = kept.take(survivor), got.take(at)
    for name in ("records", "attributes", "boxes"):
        wrong = _differ(getattr(got, name), getattr(expected, name))
        if wrong.any():
            yield f"{np.count_nonzero(wrong)} {name}, the first in tile {tile[int(wrong.argmax())]}"


def _differ(a: Array, b: Array) -> Array:
    """(N,) bool whether any bit of a row differs; padding does not count."""
    if a.dtype.names:
        columns = [(a[name], b[name]) for name in a.dtype.names if name != "pad"]
    else:
        columns = list(zip(a.T, b.T, strict=True))
    return np.logical_or.reduce([_bits(x) != _bits(y) for x, y in columns])


def _bits(values: Array) -> Array:
    return np.ascontiguousarray(values).view(f"u{values.itemsize}")


def _check_binning(faults: list[str], num_copies: int, num_listed: int, num_tiles: int) -> Check:
    detail = f"{num_copies} times a splat touches a tile, all among {num_listed} entries of {num_tiles} lists, in order"
    return Check("binning", not faults, f"wrong: {'; '.join(faults)}" if faults else detail)


# ---- fragments and colour


def _count_fragments(passes: Passes, view: Any, splats: ResidentSplats, depth: DepthBuffer, epsilon: float) -> int:
    """Count the fragments splat by splat (kernels/evidence/accounting.cl)."""
    (epsilon, along, _, inverse_radius2, _, _), options = pipeline.fragment_arguments(passes, epsilon)
    total = 0
    for lists in pipeline.in_order(passes, splats.num_splats):
        projected, num = pipeline.project(passes, view, splats, lists), int(lists.begin[-1])
        num_chunks = -(-num // CHUNK)
        counts = passes.device.buffer(num_chunks * 8)
        passes.run(
            "accounting", (num_chunks,), view, projected.records, projected.extra, projected.attributes,
            projected.boxes, num, CHUNK, epsilon, along, inverse_radius2, depth.depth, counts,
            **{**projected.options, **options, **ONE_LANE},
        )  # fmt: skip
        total += int(passes.device.read(counts, (num_chunks,), np.uint64).sum())
    return total


def _check_fragments(num_fragments: int, count: Array) -> Check:
    total = int(count.sum(dtype=np.uint64))
    detail = f"{total} by pixel {'=' if total == num_fragments else 'but'} {num_fragments} by splat"
    return Check("fragments", total == num_fragments, detail)


def color_bound(count: Array, weight: Array, target: Target = "auto") -> Array:
    """Return by how much a constant colour may come out changed, relative, after sums of `count` terms.

    To first order (2 count + 1) u with u = 2^-24 (2^-53): count roundings of products and sums in the numerator, count
    - 1 in the denominator, one of the quotient, one of the colour itself; products below the normal range lose more.
    """
    limits = np.finfo(TARGET_TYPES.get(target, weight.dtype))
    unit = float(limits.eps) / 2
    terms = 2 * count.astype(np.float64) + 1
    return terms * unit / (1 - terms * unit) + count * float(limits.tiny) / weight


def _check_color(albedo: Array, weight: Array, count: Array, target: Target) -> Check:
    if target == "unorm8":
        return Check("constant colour", True, "not asked for: unorm8 clamps its sums")
    covered = weight > 0
    albedo, weight, count = albedo[covered], weight[covered], count[covered]
    exact = np.count_nonzero(albedo[:, 0] != CONSTANT_COLOR[0])
    error = np.abs(albedo[:, 1:].astype(np.float64) / CONSTANT_COLOR[1:] - 1)
    outside = np.count_nonzero(error > color_bound(count, weight, target)[:, None])
    detail = f"1 comes out as 1 at {len(albedo) - exact} of {len(albedo)} pixels"
    detail += f", {CONSTANT_COLOR[1]} and 1/3 to within {error.max(initial=0.0):.1e}"
    if outside:
        detail += f", {outside} times outside the bound"
    return Check("constant colour", not exact and not outside, detail)
