"""The passes at one pixel, splat by splat (kernels/probe.cl)."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splatcl import oracle
from splatcl.errors import SplatclError
from splatcl.evidence.host.pairs import MAX_MARGIN, Pairs, decisions, fragments
from splatcl.evidence.probe_report import (
    BEHIND,
    CLIPPED,
    EDGE_ON_SPLAT,
    FILTER,
    FOOTPRINT,
    REACH,
    Probe,
    ProbeRow,
    Sums,
)
from splatcl.opencl.passes.attributes import fragment_arguments
from splatcl.opencl.passes.bin import all_splats, one_tile
from splatcl.opencl.passes.project import project
from splatcl.opencl.session import Session, UploadedSplats
from splatcl.opencl.state.buffers import TileLists
from splatcl.opencl.state.context import PER_FRAGMENT, PREFILTERS, PassContext
from splatcl.opencl.state.lights import shading_structs
from splatcl.opencl.state.upload import DeviceSplats
from splatcl.scene.camera import Camera
from splatcl.scene.settings import RenderSettings

Array = NDArray[Any]
CHUNK = 4096
"""Records that a work-item looks through."""
HIT, OUT, EXISTS, ACCEPTED, EDGE_ON, CUT = 1, 2, 4, 8, 16, 32
"""Bits of ProbedSplat.state (kernels/probe.cl)."""
CULLED, UNSEEN, MISSED = "culled", "out of near..far", "missed"


@dataclass(frozen=True)
class AtPixel:
    """The rows of ProbedSplat (layout.py), each array in splat order, and what the visibility pass found."""

    seen: Array  # splats that the frame's projection kept
    unseen: dict[str, Array]  # those it left out, by the reason
    depth: float  # eye z, scene units
    particleid: int


def at_pixel(
    session: Session, uploaded: UploadedSplats, camera: Camera, settings: RenderSettings, pixel: tuple[int, int]
) -> AtPixel:
    """Run the passes for one pixel, column and row."""
    device = session.device
    depth, particleid = device.buffer(8), device.buffer(4)
    rows: dict[str, Array] = {}
    known = np.zeros(0, np.uint32)
    for reason, wider_camera, wider_settings in _projections(camera, settings):
        context, on_device = session.pass_inputs(uploaded, wider_camera, wider_settings)
        view = context.view(on_device.origin)
        near = _nearby(context, view, on_device, pixel)
        projected = project(context, view, on_device, near)
        num = int(near.begin[-1])
        at = (
            projected.records,
            projected.extra,
            projected.attributes,
            near.ids,
            num,
            *pixel,
            camera.near,
            camera.far,
            depth,
        )
        arguments, options = fragment_arguments(context, uploaded.epsilon(settings))
        options = {**projected.options, **options, **OPTIONS, "PREFILTER": PREFILTERS[settings.prefilter]}
        if not reason:
            context.run("probe_depth", (1,), *at, particleid, **options)
        structs = shading_structs(context) if options["SHADING"] == PER_FRAGMENT else ()
        output = device.buffer(num * context.dtypes["ProbedSplat"].itemsize)
        context.run("probe_rows", (1,), view, *at, *arguments, output, *structs, **options)
        found = device.read(output, (num,), context.dtypes["ProbedSplat"])
        rows[reason] = found[~np.isin(found["id"], known)]
        known = np.union1d(known, found["id"])
    z, front = device.read(depth, (1,), context.real), device.read(particleid, (1,), np.uint32)
    return AtPixel(rows.pop(""), rows, z[0].item(), front[0].item())


OPTIONS = {"LANES": 1, "CHANNELS": 0}


def _projections(camera: Camera, settings: RenderSettings) -> Iterator[tuple[str, Camera, RenderSettings]]:
    """Yield the frame's own projection, then wider ones: each shows more splats, left out for the reason given."""
    yield "", camera, settings
    if settings.facing == "cull":
        settings = replace(settings, facing="keep")
        yield CULLED, camera, settings
    near = camera.near * 1e-6 if camera.projection == "perspective" else -1e15
    camera = replace(camera, near=near, far=float("inf"))
    yield UNSEEN, camera, settings
    if settings.prefilter == "none":
        yield MISSED, camera, replace(settings, prefilter="min")


def _nearby(context: PassContext, view: Any, splats: DeviceSplats, pixel: tuple[int, int]) -> TileLists:
    """List the splats that are nearly at the pixel."""
    device, found = context.device, [np.zeros(0, np.int32)]
    for lists in all_splats(context, splats.num_splats):
        projected, num = project(context, view, splats, lists), int(lists.begin[-1])
        num_chunks = -(-num // CHUNK)
        ids, counts = device.buffer(num * 4), device.buffer(num_chunks * 4)
        context.run(
            "probe_select", (num_chunks,), projected.records, projected.extra, projected.attributes, projected.near_z,
            lists.ids, num, CHUNK, *pixel, REACH, context.settings.prefilter_radius**-2, ids, counts,
            **{**projected.options, **fragment_arguments(context, 0.0)[1], **OPTIONS},
        )  # fmt: skip
        lengths, places = device.read(counts, (num_chunks,), np.int32), device.read(ids, (num,), np.int32)
        found += [places[i * CHUNK : i * CHUNK + length] for i, length in enumerate(lengths)]
    return one_tile(context, np.concatenate(found))


def probe(
    session: Session,
    uploaded: UploadedSplats,
    camera: Camera,
    settings: RenderSettings,
    aovs: Mapping[str, Array],
    x: int,
    y: int,
) -> Probe:
    """Explain the pixel in column `x` and row `y` of a frame; see `Frame.probe`.

    `uploaded` is prepared for the settings (`UploadedSplats.prepared`); `aovs` are the frame's.
    """
    if not (0 <= x < camera.width and 0 <= y < camera.height):
        raise SplatclError(
            f"pixel ({x}, {y}) is outside the image: x is 0 to {camera.width - 1}, y is 0 to {camera.height - 1}"
        )
    found = session.call(at_pixel, uploaded, camera, settings, (x, y))
    rows = sorted(
        [*_seen_rows(found.seen, settings), *_unseen_rows(found.unseen, found.seen)], key=lambda row: row.splat
    )
    margins = _margins(uploaded, [row.splat for row in rows], camera, settings, x, y)
    return Probe(
        x,
        y,
        tuple(replace(row, margin=margin) for row, margin in zip(rows, margins, strict=True)),
        found.depth,
        found.particleid,
        uploaded.epsilon(settings),
        weight=aovs["weight"][y, x].item(),
        count=aovs["count"][y, x].item(),
        albedo=tuple((aovs["albedo"] if "albedo" in aovs else aovs["color"][..., :3])[y, x].tolist()),
        normal=tuple(aovs["N"][y, x].tolist()),
        color=tuple(aovs["color"][y, x].tolist()),
        margin=min(margins, default=MAX_MARGIN),
    )


def _seen_rows(seen: Array, settings: RenderSettings) -> Iterator[ProbeRow]:
    for raw in seen:
        state = int(raw["state"])
        if state & ACCEPTED:
            verdict = "disc" if state & HIT else FILTER
            if settings.footprint != "raycast" and settings.prefilter == "none":
                verdict = FOOTPRINT if verdict == FILTER else verdict
        elif state & EXISTS:
            verdict = BEHIND
        else:
            verdict = (
                EDGE_ON_SPLAT if state & EDGE_ON else UNSEEN if state & OUT else CLIPPED if state & CUT else MISSED
            )
        yield _row(raw, verdict, _sums(raw))


def _unseen_rows(unseen: dict[str, Array], seen: Array) -> Iterator[ProbeRow]:
    """Yield rows of splats that the passes never saw: the sums stay as they are."""
    for reason, rows in unseen.items():
        for raw in rows:
            before = np.searchsorted(seen["id"], raw["id"])
            sums = _sums(seen[before - 1]) if before else Sums(0.0, (0.0,) * 3, (0.0,) * 3, 0)
            verdict = EDGE_ON_SPLAT if raw["state"] & EDGE_ON and reason == MISSED else reason
            yield replace(_row(raw, verdict, sums), weight=0.0)


def _sums(raw: Any) -> Sums:
    color = (raw["red"].item(), raw["green"].item(), raw["blue"].item())
    normal = (raw["normal_x"].item(), raw["normal_y"].item(), raw["normal_z"].item())
    return Sums(raw["weight_sum"].item(), color, normal, raw["count"].item())


def _row(raw: Any, verdict: str, sums: Sums) -> ProbeRow:
    u, v, r2, r3, z, weight = (raw[name].item() for name in ("u", "v", "r2", "r3", "z", "weight"))
    if raw["state"] & EDGE_ON:
        u, v, r3 = math.nan, math.nan, math.inf
    return ProbeRow(raw["id"].item(), u, v, r2, r3, z, weight, verdict, MAX_MARGIN, sums)


def _margins(
    uploaded: UploadedSplats, ids: list[int], camera: Camera, settings: RenderSettings, x: int, y: int
) -> list[float]:
    """Return the oracle's margin of each splat's decisions at the pixel, beside the other splats listed."""
    num = len(ids)
    if not num:
        return []
    settings = replace(settings, circular=False)  # the uploaded splats are circles already
    projected = oracle.project.project(uploaded.splats.take(ids), camera, settings)
    ray = ((x + 0.5 - camera.cx) / camera.fx, (y + 0.5 - camera.cy) / camera.fy, 1.0)
    one = np.zeros(1, np.int64)
    pairs = Pairs(one, one, np.arange(num), np.zeros(num, np.int64), np.tile(ray, (num, 1)))
    units, _ = decisions(pairs, fragments(pairs, projected, camera, settings, uploaded.epsilon(settings)))
    return np.minimum(units, MAX_MARGIN).tolist()
