"""The passes at one pixel, splat by splat (kernels/probe.cl)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splatcl import pipeline
from splatcl.camera import Camera
from splatcl.pipeline import Passes, ProjectedSplats
from splatcl.render import Renderer, Resident
from splatcl.settings import RenderSettings

Array = NDArray[Any]
REACH = 1.25
"""A splat is nearly at a pixel if its disc or its pre-filter's, this many times as large, covers the pixel."""
HIT, OUT, EXISTS, ACCEPTED, EDGE_ON = 1, 2, 4, 8, 16
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
        projected = pipeline.project(passes, view, on_device)
        places = _places(passes, projected, on_device.num_splats, pixel)
        at = (passes.constant(places), len(places) - 1, *pixel, camera.near, camera.far, depth)
        if not reason:
            passes.run("probe_depth", (1,), projected.records, *at, particleid, **OPTIONS)
        arguments, options = pipeline.fragment_arguments(passes, resident.epsilon(settings))
        options["PREFILTER"] = int(settings.prefilter == "min")
        output = device.buffer(len(places) * passes.dtypes["ProbedSplat"].itemsize)
        inputs = (view, projected.records, projected.attributes)
        passes.run("probe_rows", (1,), *inputs, *at, *arguments, output, **OPTIONS | options)
        found = device.read(output, (len(places) - 1,), passes.dtypes["ProbedSplat"])
        rows[reason] = found[~np.isin(found["id"], known)]
        known = np.union1d(known, found["id"])
    z, front = device.read(depth, (1,), passes.real), device.read(particleid, (1,), np.uint32)
    return AtPixel(rows.pop(""), rows, z[0].item(), front[0].item())


OPTIONS = {"LANES": 1, "REGION": 1, "PREFILTER": 0, "KERNEL": 0}


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


def _places(passes: Passes, projected: ProjectedSplats, num_splats: int, pixel: tuple[int, int]) -> NDArray[np.int32]:
    """Return where the records are of the splats that are nearly at the pixel, and a last -1."""
    device, num_chunks = passes.device, projected.num_chunks
    places, num_places = device.buffer(num_splats * 4), device.buffer(num_chunks * 4)
    passes.run(
        "probe_select", (num_chunks,), projected.records, projected.attributes, projected.num_survivors,
        projected.chunk_size, *pixel, REACH, passes.settings.prefilter_radius**-2, places, num_places, **OPTIONS,
    )  # fmt: skip
    counts, found = device.read(num_places, (num_chunks,), np.int32), device.read(places, (num_splats,), np.int32)
    starts = np.arange(num_chunks) * projected.chunk_size
    runs = (found[start : start + count] for start, count in zip(starts, counts, strict=True))
    return np.concatenate([*runs, np.full(1, -1, np.int32)])
