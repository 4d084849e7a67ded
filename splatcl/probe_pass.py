"""The passes at one pixel, splat by splat (kernels/evidence/probe.cl)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splatcl import pipeline
from splatcl.camera import Camera
from splatcl.lighting import shading_structs
from splatcl.passes import PER_FRAGMENT, PREFILTERS, Passes
from splatcl.pipeline import TileLists
from splatcl.render import Renderer, Resident
from splatcl.resident import ResidentSplats
from splatcl.settings import RenderSettings

Array = NDArray[Any]
REACH = 1.25
"""A splat is nearly at a pixel if its disc or its pre-filter's, this many times as large, covers the pixel."""
CHUNK = 4096
"""Records that a work-item looks through."""
HIT, OUT, EXISTS, ACCEPTED, EDGE_ON, CUT = 1, 2, 4, 8, 16, 32
"""Bits of ProbedSplat.state (kernels/evidence/probe.cl)."""
CULLED, UNSEEN, MISSED = "culled", "out of near..far", "missed"


@dataclass(frozen=True)
class AtPixel:
    """The rows of ProbedSplat (layout.py), each array in splat order, and what the visibility pass found."""

    seen: Array  # splats that the frame's projection kept
    unseen: dict[str, Array]  # those it left out, by the reason
    depth: float  # eye z, scene units
    particleid: int


def at_pixel(
    renderer: Renderer, resident: Resident, camera: Camera, settings: RenderSettings, pixel: tuple[int, int]
) -> AtPixel:
    """Run the passes for one pixel, column and row."""
    device = renderer.device
    depth, particleid = device.buffer(8), device.buffer(4)
    rows: dict[str, Array] = {}
    known = np.zeros(0, np.uint32)
    for reason, wider_camera, wider_settings in _projections(camera, settings):
        passes, on_device = renderer.prepare(resident, wider_camera, wider_settings)
        view = passes.view(on_device.origin)
        near = _nearby(passes, view, on_device, pixel)
        projected = pipeline.project(passes, view, on_device, near)
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
        arguments, options = pipeline.fragment_arguments(passes, resident.epsilon(settings))
        options = {**projected.options, **options, **OPTIONS, "PREFILTER": PREFILTERS[settings.prefilter]}
        if not reason:
            passes.run("probe_depth", (1,), *at, particleid, **options)
        structs = shading_structs(passes) if options["SHADING"] == PER_FRAGMENT else ()
        output = device.buffer(num * passes.dtypes["ProbedSplat"].itemsize)
        passes.run("probe_rows", (1,), view, *at, *arguments, output, *structs, **options)
        found = device.read(output, (num,), passes.dtypes["ProbedSplat"])
        rows[reason] = found[~np.isin(found["id"], known)]
        known = np.union1d(known, found["id"])
    z, front = device.read(depth, (1,), passes.real), device.read(particleid, (1,), np.uint32)
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


def _nearby(passes: Passes, view: Any, splats: ResidentSplats, pixel: tuple[int, int]) -> TileLists:
    """List the splats that are nearly at the pixel."""
    device, found = passes.device, [np.zeros(0, np.int32)]
    for lists in pipeline.in_order(passes, splats.num_splats):
        projected, num = pipeline.project(passes, view, splats, lists), int(lists.begin[-1])
        num_chunks = -(-num // CHUNK)
        ids, counts = device.buffer(num * 4), device.buffer(num_chunks * 4)
        passes.run(
            "probe_select", (num_chunks,), projected.records, projected.extra, projected.attributes, projected.near_z,
            lists.ids, num, CHUNK, *pixel, REACH, passes.settings.prefilter_radius**-2, ids, counts,
            **{**projected.options, **pipeline.fragment_arguments(passes, 0.0)[1], **OPTIONS},
        )  # fmt: skip
        lengths, places = device.read(counts, (num_chunks,), np.int32), device.read(ids, (num,), np.int32)
        found += [places[i * CHUNK : i * CHUNK + length] for i, length in enumerate(lengths)]
    return pipeline.listed(passes, np.concatenate(found))
