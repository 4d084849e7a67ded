"""Explain one pixel: run the passes there, splat by splat (kernels/evidence/probe.cl).

The kernels call the functions of the visibility and attribute passes. The running sums therefore end at the frame's
weight, count, Z and particleid, bit for bit. The margins are the float64 oracle's.
"""

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
"""Records that one work-item tests."""
HIT, OUT, EXISTS, ACCEPTED, EDGE_ON, CUT = 1, 2, 4, 8, 16, 32
"""Bits of ProbedSplat.state (kernels/evidence/probe.cl)."""
CULLED, OUT_OF_RANGE, MISSED = "culled", "out of near..far", "missed"
"""Verdicts of splats that the frame's projection drops."""
OPTIONS = {"LANES": 1, "CHANNELS": 0}
"""Build options of kernels/evidence/probe.cl."""


@dataclass(frozen=True)
class ProbedPixel:
    """The splats at a pixel, and the result of the visibility pass there; arrays are in splat order."""

    kept: Array  # (K,) ProbedSplat, splats that the frame's projection keeps
    dropped: dict[str, Array]  # (D,) ProbedSplat, splats that it drops, by the verdict
    depth: float  # depth(p), eye z, scene units; inf where no disc is hit
    particleid: int  # index of the splat that set it; 0xFFFFFFFF where there is none


def at_pixel(
    session: Session, uploaded: UploadedSplats, camera: Camera, settings: RenderSettings, pixel: tuple[int, int]
) -> ProbedPixel:
    """Run the passes for one pixel, (column, row). For `Session.call`."""
    device = session.device
    depth, particleid = device.buffer(8), device.buffer(4)
    rows: dict[str, Array] = {}
    known = np.zeros(0, np.uint32)
    for verdict, wider_camera, wider_settings in _projections(camera, settings):
        context, on_device = session.pass_inputs(uploaded, wider_camera, wider_settings)
        view = context.view(on_device.origin)
        lists = _candidates(context, view, on_device, pixel)
        projected = project(context, view, on_device, lists)
        num = int(lists.begin[-1])
        inputs = (
            projected.records, projected.extra, projected.attributes, lists.ids, num, *pixel, camera.near, camera.far,
            depth,
        )  # fmt: skip
        arguments, options = fragment_arguments(context, uploaded.epsilon(settings))
        options = {**projected.options, **options, **OPTIONS, "PREFILTER": PREFILTERS[settings.prefilter]}
        if not verdict:
            context.run("probe_depth", (1,), *inputs, particleid, **options)
        structs = shading_structs(context) if options["SHADING"] == PER_FRAGMENT else ()
        output = device.buffer(num * context.dtypes["ProbedSplat"].itemsize)
        context.run("probe_rows", (1,), view, *inputs, *arguments, projected.boxes, output, *structs, **options)
        found = device.read(output, (num,), context.dtypes["ProbedSplat"])
        rows[verdict] = found[~np.isin(found["id"], known)]
        known = np.union1d(known, found["id"])
    z, front = device.read(depth, (1,), context.real), device.read(particleid, (1,), np.uint32)
    return ProbedPixel(rows.pop(""), rows, z[0].item(), front[0].item())


def _projections(camera: Camera, settings: RenderSettings) -> Iterator[tuple[str, Camera, RenderSettings]]:
    """Yield the frame's own projection, then wider ones; the verdict is that of the splats which one adds."""
    yield "", camera, settings
    if settings.facing == "cull":
        settings = replace(settings, facing="keep")
        yield CULLED, camera, settings
    near = camera.near * 1e-6 if camera.projection == "perspective" else -1e15
    camera = replace(camera, near=near, far=float("inf"))
    yield OUT_OF_RANGE, camera, settings
    if settings.prefilter == "none":
        yield MISSED, camera, replace(settings, prefilter="min")


def _candidates(context: PassContext, view: Any, splats: DeviceSplats, pixel: tuple[int, int]) -> TileLists:
    """List the splats whose disc or pre-filter, enlarged by `REACH`, covers the pixel."""
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
        lengths, chosen = device.read(counts, (num_chunks,), np.int32), device.read(ids, (num,), np.int32)
        found += [chosen[i * CHUNK : i * CHUNK + length] for i, length in enumerate(lengths)]
    return one_tile(context, np.concatenate(found))


def probe(
    session: Session,
    uploaded: UploadedSplats,
    camera: Camera,
    settings: RenderSettings,
    aovs: Mapping[str, Array],
    pixel: tuple[int, int],
) -> Probe:
    """Explain a pixel of a frame; see `Frame.probe`.

    Parameters
    ----------
    session : Session
    uploaded : UploadedSplats
        Prepared for the settings (`UploadedSplats.prepared`).
    camera, settings
        Those of the frame.
    aovs : mapping of str to array
        AOVs of the frame.
    pixel : tuple of int
        Column and row.

    Raises
    ------
    SplatclError
        The pixel is outside the image.
    """
    x, y = pixel
    if not (0 <= x < camera.width and 0 <= y < camera.height):
        raise SplatclError(
            f"pixel ({x}, {y}) is outside the image: x is 0 to {camera.width - 1}, y is 0 to {camera.height - 1}"
        )
    found = session.call(at_pixel, uploaded, camera, settings, pixel)
    rows = [*_kept_rows(found.kept, settings), *_dropped_rows(found.dropped, found.kept)]
    rows.sort(key=lambda row: row.splat)
    margins = _margins(uploaded, [row.splat for row in rows], camera, settings, pixel)
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


def _kept_rows(kept: Array, settings: RenderSettings) -> Iterator[ProbeRow]:
    for raw in kept:
        state = int(raw["state"])
        if state & ACCEPTED:
            verdict = "disc" if state & HIT else FILTER
            if settings.footprint != "raycast" and settings.prefilter == "none":
                verdict = FOOTPRINT if verdict == FILTER else verdict
        elif state & EXISTS:
            verdict = BEHIND
        else:
            reasons = ((EDGE_ON, EDGE_ON_SPLAT), (OUT, OUT_OF_RANGE), (CUT, CLIPPED))
            verdict = next((reason for bit, reason in reasons if state & bit), MISSED)
        yield _row(raw, verdict, _sums(raw))


def _dropped_rows(dropped: dict[str, Array], kept: Array) -> Iterator[ProbeRow]:
    """Yield rows of splats that the projection drops; their sums are those of the kept splat before."""
    for reason, rows in dropped.items():
        for raw in rows:
            before = np.searchsorted(kept["id"], raw["id"])
            sums = _sums(kept[before - 1]) if before else Sums(0.0, (0.0,) * 3, (0.0,) * 3, 0)
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
    uploaded: UploadedSplats, ids: list[int], camera: Camera, settings: RenderSettings, pixel: tuple[int, int]
) -> list[float]:
    """Return the oracle's margin of each splat's decisions at the pixel, in the presence of the other `ids`."""
    num = len(ids)
    if not num:
        return []
    settings = replace(settings, circular=False)  # the uploaded splats are already circles
    projected = oracle.project.project(uploaded.splats.take(ids), camera, settings)
    column, row = pixel
    ray = ((column + 0.5 - camera.cx) / camera.fx, (row + 0.5 - camera.cy) / camera.fy, 1.0)
    one = np.zeros(1, np.int64)
    pairs = Pairs(one, one, np.arange(num), np.zeros(num, np.int64), np.tile(ray, (num, 1)))
    units, _ = decisions(pairs, fragments(pairs, projected, camera, settings, uploaded.epsilon(settings)))
    return np.minimum(units, MAX_MARGIN).tolist()
