"""Conservation: what goes into a render and what comes out of it must add up, exactly (docs/probe.md)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splatcl import oracle, pipeline
from splatcl.camera import Camera
from splatcl.frame import Frame
from splatcl.pipeline import DepthBuffer, Passes, ProjectedSplats, TileLists
from splatcl.render import DeviceAovs, Renderer, Resident
from splatcl.settings import RenderSettings
from splatcl.splats import Splats

Array = NDArray[Any]
CONSTANT_COLOR = (1.0, 0.7, 1 / 3)
"""Red must come out as it is; the others to within the rounding of their sums."""
SUSPECTS = 100
"""Splats that should not have been left out are drawn by the oracle, one by one; of more this many are."""
BEYOND_DOUBT = 32.0
"""Margin, in rounding errors, from which a float32 renderer decides as the oracle does (tests/tolerances.py)."""
SPLATS_AT_ONCE = 1 << 18


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
    passes, on_device = renderer.prepare(resident, camera, settings)
    color = np.tile(np.array(CONSTANT_COLOR, passes.real)[:, None], on_device.stride)
    view = passes.view(on_device.origin)
    projected = pipeline.project(passes, view, replace(on_device, color=passes.constant(color)))
    kept = _read_projected(passes, projected, len(resident.splats))
    copies = _expected_copies(kept, passes.tile_size, passes.tiles_x)
    counted = _tile_counts(passes, projected)
    faults = [] if np.array_equal(counted, np.bincount(copies.tile, minlength=passes.num_tiles)) else ["tile counts"]
    depth, gbuffer = pipeline.frame_buffers(passes)
    for lists in pipeline.bin(passes, projected):
        faults += _run_faults(passes, kept, copies, lists)
        pipeline.visibility(passes, lists, depth)
        pipeline.attributes(passes, view, lists, depth, resident.epsilon(settings), gbuffer)
    aovs = DeviceAovs(passes, view, depth, gbuffer, None)
    num_fragments = _count_fragments(passes, view, projected, depth, resident.epsilon(settings))
    checks = [
        _check_binning(faults, len(copies.tile), passes.num_tiles),
        _check_fragments(num_fragments, aovs["count"]),
        _check_color(aovs["albedo"], aovs["weight"], aovs["count"]),
    ]
    return kept.records["id"], checks, {name: aovs[name] for name in ("Z", "particleid", "weight", "count")}


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


# ---- binning: each record has one copy in the run of each tile that its bounds touch


@dataclass(frozen=True)
class _Projected:
    """Survivors in splat order."""

    records: Array  # (S,) ProjectedSplat
    attributes: Array  # (S,) SplatAttributes


@dataclass(frozen=True)
class _Copies:
    """The copies that there must be, by tile and then by splat."""

    tile: Array  # (C,)
    survivor: Array  # (C,) index of the survivor


def _read_projected(passes: Passes, projected: ProjectedSplats, num_splats: int) -> _Projected:
    counts = passes.device.read(projected.num_survivors, (projected.num_chunks,), np.int32)
    starts = np.arange(projected.num_chunks) * projected.chunk_size
    places = np.repeat(starts - np.cumsum(counts) + counts, counts) + np.arange(counts.sum())
    dtypes = passes.dtypes
    records = passes.device.read(projected.records, (num_splats,), dtypes["ProjectedSplat"])[places]
    attributes = passes.device.read(projected.attributes, (num_splats,), dtypes["SplatAttributes"])[places]
    return _Projected(records, attributes)


def _expected_copies(kept: _Projected, tile_size: int, tiles_x: int) -> _Copies:
    x, y = kept.records["x_min"] // tile_size, kept.records["y_min"] // tile_size
    across = kept.records["x_max"] // tile_size - x + 1
    num_copies = across * (kept.records["y_max"] // tile_size - y + 1).astype(np.int64)
    survivor = np.repeat(np.arange(len(num_copies)), num_copies)
    nth = np.arange(len(survivor)) - np.repeat(np.cumsum(num_copies) - num_copies, num_copies)
    tile = (y[survivor] + nth // across[survivor]) * tiles_x + x[survivor] + nth % across[survivor]
    order = np.argsort(tile, kind="stable")
    return _Copies(tile[order], survivor[order])


def _tile_counts(passes: Passes, projected: ProjectedSplats) -> Array:
    """(num_tiles,) what the projection counted for each tile, over all chunks."""
    shape = (projected.num_chunks, projected.num_tiles)
    return passes.device.read(projected.tile_counts, shape, np.int32).sum(axis=0, dtype=np.int64)


def _run_faults(passes: Passes, kept: _Projected, copies: _Copies, lists: TileLists) -> Iterator[str]:
    """Yield what is wrong with a band's runs: their lengths, records or attributes."""
    ends = np.searchsorted(copies.tile, np.arange(lists.first_tile, lists.last_tile + 1))
    if not np.array_equal(lists.begin, ends - ends[0]):
        yield f"run lengths of tiles {lists.first_tile} to {lists.last_tile - 1}"
        return
    expected = copies.survivor[ends[0] : ends[-1]]
    for buffer, name, wanted in (
        (lists.records, "ProjectedSplat", kept.records),
        (lists.attributes, "SplatAttributes", kept.attributes),
    ):
        got = passes.device.read(buffer, expected.shape, passes.dtypes[name])
        wrong = np.logical_or.reduce(
            [_bits(got[field]) != _bits(wanted[field])[expected] for field in got.dtype.names or ()]
        )
        if wrong.any():
            tile = copies.tile[ends[0] + int(wrong.argmax())]
            yield f"{np.count_nonzero(wrong)} copies of {name}, the first in tile {tile}"


def _bits(values: Array) -> Array:
    return np.ascontiguousarray(values).view(f"u{values.itemsize}")


def _check_binning(faults: list[str], num_copies: int, num_tiles: int) -> Check:
    detail = f"{num_copies} copies of records in {num_tiles} runs, one for each tile that a record touches, in order"
    return Check("binning", not faults, f"wrong: {'; '.join(faults)}" if faults else detail)


# ---- fragments and colour


def _count_fragments(passes: Passes, view: Any, projected: ProjectedSplats, depth: DepthBuffer, epsilon: float) -> int:
    """Count the fragments splat by splat (kernels/accounting.cl)."""
    counts = passes.device.buffer(projected.num_chunks * 8)
    (epsilon, along, _, inverse_radius2, _, _), options = pipeline.fragment_arguments(passes, epsilon)
    passes.run(
        "accounting", (projected.num_chunks,), view, projected.records, projected.attributes, projected.num_survivors,
        projected.chunk_size, epsilon, along, inverse_radius2, depth.depth, counts,
        LANES=1, REGION=1, PREFILTER=options["PREFILTER"],
    )  # fmt: skip
    return int(passes.device.read(counts, (projected.num_chunks,), np.uint64).sum())


def _check_fragments(num_fragments: int, count: Array) -> Check:
    total = int(count.sum(dtype=np.uint64))
    detail = f"{total} by pixel {'=' if total == num_fragments else 'but'} {num_fragments} by splat"
    return Check("fragments", total == num_fragments, detail)


def color_bound(count: Array, weight: Array) -> Array:
    """Return by how much a constant colour may come out changed, relative, after sums of `count` terms.

    To first order (2 count + 1) u with u = 2^-24 (2^-53): count roundings of products and sums in the numerator, count
    - 1 in the denominator, one of the quotient, one of the colour itself; products below the normal range lose more.
    """
    limits = np.finfo(weight.dtype)
    unit = float(limits.eps) / 2
    terms = 2 * count.astype(np.float64) + 1
    return terms * unit / (1 - terms * unit) + count * float(limits.tiny) / weight


def _check_color(albedo: Array, weight: Array, count: Array) -> Check:
    covered = weight > 0
    albedo, weight, count = albedo[covered], weight[covered], count[covered]
    exact = np.count_nonzero(albedo[:, 0] != CONSTANT_COLOR[0])
    error = np.abs(albedo[:, 1:].astype(np.float64) / CONSTANT_COLOR[1:] - 1)
    outside = np.count_nonzero(error > color_bound(count, weight)[:, None])
    detail = f"1 comes out as 1 at {len(albedo) - exact} of {len(albedo)} pixels"
    detail += f", {CONSTANT_COLOR[1]} and 1/3 to within {error.max(initial=0.0):.1e}"
    if outside:
        detail += f", {outside} times outside the bound"
    return Check("constant colour", not exact and not outside, detail)
