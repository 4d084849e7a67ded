"""The one place of the benchmark that calls the pipeline's passes and knows their buffers."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splatcl.opencl.passes.attributes import attributes
from splatcl.opencl.passes.bin import bin
from splatcl.opencl.passes.occlusion import occlusion
from splatcl.opencl.passes.project import project
from splatcl.opencl.passes.shade import shade
from splatcl.opencl.passes.visibility import visibility
from splatcl.opencl.session import UploadedSplats
from splatcl.opencl.state.buffers import Band, DepthBuffer, ProjectedSplats, Raster, TileLists
from splatcl.opencl.state.context import BEHIND, PassContext, frame_buffers
from splatcl.renderer import Renderer
from splatcl.scene.camera import Camera
from splatcl.scene.settings import RenderSettings, effective_settings

PASSES = ("bin", "project", "visibility", "attributes", "shade")
BLOCKS = {1: (1, 1), 4: (2, 2), 8: (4, 2), 16: (4, 4)}
"""Pixels of one vector by its lanes (kernels/arithmetic/lanes.h)."""
SMALL = 4
"""Boxes of at most so many pixels each way are taken a vector of splats at a time (kernels/passes/tile.h)."""
BOX = ("x_min", "y_min", "x_max", "y_max")


@dataclass(frozen=True)
class Counts:
    """How much there is to do in the passes of one frame, and the sizes of what they move, bytes."""

    num_splats: int
    num_listed: int  # splats in at least one tile's list
    num_entries: int  # of all tiles' lists
    num_projected: int  # entries that have pixels and are not passed over, as nearer splats hide them
    num_discs: int  # entries whose disc has pixels: those that visibility takes
    num_near: int  # entries that have pixels and are no farther than their tile's farthest: those attributes takes
    visibility_lanes: int
    attribute_lanes: int
    num_pixels: int
    plane_bytes: int
    touched_bytes: int
    entry_bytes: int
    splat_bytes: int
    record_bytes: int
    attribute_bytes: int
    real_bytes: int


class FramePasses:
    """The passes of one frame, run one by one. For splats that `renderer` has uploaded."""

    def __init__(self, renderer: Renderer, uploaded: UploadedSplats, camera: Camera, settings: RenderSettings) -> None:
        uploaded = uploaded.prepared(settings)
        settings = effective_settings(settings, uploaded.splats.oriented)
        self._context, self._splats = renderer.pass_inputs(uploaded, camera, settings)
        self._epsilon = uploaded.epsilon(settings)
        self._view = self._context.view(self._splats.origin)

    def run(self, tally: Tally | None = None) -> dict[str, float]:
        """Run a frame and return each pass' seconds; wait for the device between passes.

        `tally`, if any, sees what is drawn; its time does not count.
        """
        context, view, seconds = self._context, self._view, dict.fromkeys(PASSES, 0.0)

        def timed(name: str, function: Callable[..., Any], *args: Any) -> Any:
            start = time.perf_counter()
            result = function(*args)
            context.device.queue.finish()
            seconds[name] += time.perf_counter() - start
            return result

        depth, gbuffer = frame_buffers(context)
        bands = bin(context, view, self._splats)
        while (lists := timed("bin", next, bands, None)) is not None:
            for layer in context.layers:
                if layer == BEHIND:
                    timed("project", occlusion, context, lists, depth, self._epsilon)
                projected = timed("project", project, context, view, self._splats, lists, layer)
                timed("visibility", visibility, context, lists, projected, depth, layer)
                if tally:
                    tally.add_discs(lists, projected)
            timed("attributes", attributes, context, Band(view, lists, projected, depth, self._epsilon), gbuffer)
            if tally:
                tally.add_near(lists, projected, depth)
        timed("shade", shade, context, Raster(view, depth, gbuffer, self._epsilon))
        return seconds

    def counts(self) -> Counts:
        """Run a frame and count; slow."""
        context, dtypes, real = self._context, self._context.dtypes, self._context.real.itemsize
        tally = Tally(context, self._splats.num_splats, self._epsilon)
        self.run(tally)
        low_words = 0 if self._splats.center_low is None else 3
        return Counts(
            num_splats=self._splats.num_splats,
            num_listed=int(np.count_nonzero(tally.listed)),
            **tally.totals,
            num_pixels=context.num_pixels,
            plane_bytes=9 * real,
            touched_bytes=dtypes["TouchedQuarters"].itemsize,
            entry_bytes=4 * len(context.layers),  # the id, and with layers the occlusion key
            splat_bytes=dtypes["Splat"].itemsize + low_words * real,
            record_bytes=dtypes["ProjectedSplat"].itemsize,
            attribute_bytes=dtypes["SplatAttributes"].itemsize,
            real_bytes=real,
        )


class Tally:
    """Counts over the bands of one frame, as if each work-item took a whole tile and epsilon were along z."""

    def __init__(self, context: PassContext, num_splats: int, epsilon: float) -> None:
        names = ("num_entries", "num_projected", "num_discs", "num_near", "visibility_lanes", "attribute_lanes")
        self.totals = Counter(dict.fromkeys(names, 0))
        self.listed = np.zeros(num_splats, bool)
        self._context, self._epsilon = context, epsilon

    def add_discs(self, lists: TileLists, projected: ProjectedSplats) -> None:
        """Count the discs of a band's layer."""
        if not lists.begin[-1]:
            return
        has_disc = self._read(projected.disc_near_z, lists) < np.inf  # not if it is NaN
        records = self._read(projected.records, lists, self._context.dtypes["ProjectedSplat"])
        boxes = np.stack([records[name] for name in BOX], axis=1)
        self.totals.update(
            num_discs=int(np.count_nonzero(has_disc)), visibility_lanes=self._lanes(boxes, lists, has_disc)
        )

    def add_near(self, lists: TileLists, projected: ProjectedSplats, depth: DepthBuffer) -> None:
        """Count what is near of a band, once all of it is drawn."""
        if not lists.begin[-1]:
            return
        self.listed[self._ids(lists)] = True
        near_z = self._read(projected.near_z, lists)
        is_near = near_z <= self._farthest(depth)[_tiles(lists)]  # not if it is NaN
        boxes = self._read(projected.boxes, lists, np.dtype((np.int16, 4)))
        self.totals.update(
            num_entries=int(lists.begin[-1]),
            num_projected=int(np.count_nonzero(near_z < np.inf)),
            num_near=int(np.count_nonzero(is_near)),
            attribute_lanes=self._lanes(boxes, lists, is_near),
        )

    def _lanes(self, boxes: NDArray[Any], lists: TileLists, taken: NDArray[Any]) -> int:
        context = self._context
        return lanes_of(boxes[taken], _tiles(lists)[taken], context.tiles_x, context.tile_size, context.lanes)

    def _read(self, buffer: Any, lists: TileLists, dtype: np.dtype[Any] | None = None) -> NDArray[Any]:
        return self._context.device.read(buffer, (int(lists.begin[-1]),), dtype or self._context.real)

    def _ids(self, lists: TileLists) -> NDArray[np.int32]:
        import pyopencl as cl

        ids = np.empty(lists.begin[-1], np.int32)
        cl.enqueue_copy(self._context.device.queue, ids, lists.ids, src_offset=lists.start * ids.itemsize)
        return ids

    def _farthest(self, depth: DepthBuffer) -> NDArray[Any]:
        """(T,) the farthest that is accepted anywhere in each tile."""
        context, size = self._context, self._context.tile_size
        image = context.device.read(depth.depth, (context.camera.height, context.camera.width), context.real)
        image = np.pad(image, [(0, -side % size) for side in image.shape], constant_values=-np.inf)
        tiles = image.reshape(-1, size, context.tiles_x, size)
        return (tiles.max(axis=(1, 3)) + context.real.type(self._epsilon)).ravel()


def _tiles(lists: TileLists) -> NDArray[np.int64]:
    """(N,) the tile of each entry."""
    return np.repeat(np.arange(lists.first_tile, lists.last_tile), np.diff(lists.begin))


def lanes_of(boxes: NDArray[Any], tile: NDArray[Any], tiles_x: int, tile_size: int, lanes: int) -> int:
    """Return how many lanes a raster pass evaluates for (N, 4) `boxes` in the lists of (N,) `tile`, ascending.

    A batch is `lanes` boxes of a tile, one after the other. If all are small, each position up to the largest width
    and height takes a vector; else each box is cut into blocks of `lanes` pixels from its corner.
    """
    origin = np.stack([tile % tiles_x, tile // tiles_x], axis=1) * tile_size
    low, high = np.maximum(boxes[:, :2] - origin, 0), np.minimum(boxes[:, 2:] - origin, tile_size - 1)
    size = np.where((low <= high).all(axis=1, keepdims=True), high - low + 1, 0)
    blocks = (-(-size // BLOCKS[lanes])).prod(axis=1)
    if lanes == 1:
        return int(blocks.sum())
    nth = np.arange(len(tile)) - np.searchsorted(tile, tile)
    starts = np.flatnonzero(nth % lanes == 0)
    largest = np.maximum.reduceat(size, starts, axis=0)
    small = (largest <= SMALL).all(axis=1)
    return int(np.where(small, largest.prod(axis=1), np.add.reduceat(blocks, starts)).sum()) * lanes
