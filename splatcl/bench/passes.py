"""The one place of the benchmark that calls the pipeline's passes and knows their buffers."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splatcl import pipeline
from splatcl.camera import Camera
from splatcl.pipeline import ProjectedSplats, TileLists
from splatcl.render import Renderer, Resident
from splatcl.settings import RenderSettings

PASSES = ("project", "bin", "visibility", "attributes", "shade")
BLOCKS = {1: (1, 1), 4: (2, 2), 8: (4, 2), 16: (4, 4)}
"""Pixels of one vector by its lanes (kernels/splat.h)."""
RECORDS_AT_ONCE = 1 << 20


@dataclass(frozen=True)
class Counts:
    """How much there is to do in the passes of one frame, and the sizes of what they move, bytes."""

    num_splats: int
    num_survivors: int
    num_records: int
    num_lanes: int
    num_pixels: int
    splat_bytes: int
    color_bytes: int
    record_bytes: int
    attribute_bytes: int
    real_bytes: int


class FramePasses:
    """The passes of one frame, run one by one. For splats that `renderer` has uploaded."""

    def __init__(self, renderer: Renderer, resident: Resident, camera: Camera, settings: RenderSettings) -> None:
        settings = pipeline.effective_settings(settings, resident.splats.oriented)
        self._passes, self._splats = renderer.prepare(resident, camera, settings)
        self._epsilon = resident.epsilon(settings)
        self._view = self._passes.view(self._splats.origin)

    def run(self, watch: Callable[[ProjectedSplats | TileLists], None] | None = None) -> dict[str, float]:
        """Run a frame and return each pass' seconds; wait for the device between passes.

        `watch`, if any, sees what the projection and the binning return; its time does not count.
        """
        passes, seconds = self._passes, dict.fromkeys(PASSES, 0.0)

        def timed(name: str, function: Callable[..., Any], *args: Any) -> Any:
            start = time.perf_counter()
            result = function(*args)
            passes.device.queue.finish()
            seconds[name] += time.perf_counter() - start
            return result

        projected = timed("project", pipeline.project, passes, self._view, self._splats)
        if watch:
            watch(projected)
        depth, gbuffer = pipeline.frame_buffers(passes)
        bands = pipeline.bin(passes, projected)
        while (lists := timed("bin", next, bands, None)) is not None:
            timed("visibility", pipeline.visibility, passes, lists, depth)
            timed("attributes", pipeline.attributes, passes, self._view, lists, depth, self._epsilon, gbuffer)
            if watch:
                watch(lists)
        timed("shade", pipeline.shade, passes, self._view, depth, gbuffer)
        return seconds

    def counts(self) -> Counts:
        """Run a frame and count; slow."""
        passes, dtypes = self._passes, self._passes.dtypes
        totals = {"num_survivors": 0, "num_records": 0, "num_lanes": 0}

        def watch(result: ProjectedSplats | TileLists) -> None:
            if isinstance(result, ProjectedSplats):
                survivors = passes.device.read(result.num_survivors, (result.num_chunks,), np.int32)
                totals["num_survivors"] += int(survivors.sum())
            else:
                totals["num_records"] += int(result.begin[-1])
                totals["num_lanes"] += self._num_lanes(result)

        self.run(watch)
        real = passes.real.itemsize
        num_vectors = 3 if self._splats.center_low is None else 4
        return Counts(
            num_splats=self._splats.num_splats,
            **totals,
            num_pixels=passes.num_pixels,
            splat_bytes=num_vectors * 3 * real,
            color_bytes=3 * real,
            record_bytes=dtypes["ProjectedSplat"].itemsize,
            attribute_bytes=dtypes["SplatAttributes"].itemsize,
            real_bytes=real,
        )

    def _num_lanes(self, lists: TileLists) -> int:
        """Return how many lanes a raster pass evaluates: those of the blocks that each record's bounds touch."""
        import pyopencl as cl

        passes, num_records, total = self._passes, int(lists.begin[-1]), 0
        dtype = passes.dtypes["ProjectedSplat"]
        for first in range(0, num_records, RECORDS_AT_ONCE):
            records = np.empty(min(RECORDS_AT_ONCE, num_records - first), dtype)
            cl.enqueue_copy(passes.device.queue, records, lists.records, src_offset=first * dtype.itemsize)
            place = np.arange(first, first + len(records))
            tile = lists.first_tile + np.searchsorted(lists.begin, place, side="right") - 1
            total += lanes_of(records, tile, lists.tiles_x, passes.tile_size, passes.device.lanes_of(passes.real))
        return total


def lanes_of(records: NDArray[Any], tile: NDArray[Any], tiles_x: int, tile_size: int, lanes: int) -> int:
    """Return how many lanes are in the blocks of (N,) `tile` that the bounds of (N,) `records` touch."""
    blocks = np.ones(len(records), np.int64)
    for axis, block, place in zip("xy", BLOCKS[lanes], (tile % tiles_x, tile // tiles_x), strict=True):
        origin = place * tile_size
        low = np.maximum(records[f"{axis}_min"] - origin, 0) // block
        high = np.minimum(records[f"{axis}_max"] - origin, tile_size - 1) // block
        blocks *= high - low + 1
    return int(blocks.sum()) * lanes
