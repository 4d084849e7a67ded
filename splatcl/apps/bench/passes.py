"""Run and count the passes of a frame: the only module of the benchmark that knows the passes' buffers."""

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
"""Lanes of a vector -> width and height of its block of pixels (kernels/arithmetic/lanes.h)."""
SMALL = 4
"""Largest width and height of a small box, pixels; small boxes use a vector of splats (kernels/passes/tile.h)."""
BOX = ("x_min", "y_min", "x_max", "y_max")
"""Fields of a record's box."""


@dataclass(frozen=True)
class Counts:
    """Numbers of items in the passes of one frame, and sizes of the moved items, bytes."""

    num_splats: int
    num_listed: int  # splats in the list of at least one tile
    num_entries: int  # entries of all tiles' lists
    num_projected: int  # entries that have pixels and are not culled behind nearer splats
    num_discs: int  # entries whose disc has pixels: the input of visibility
    num_near: int  # entries that have pixels within the tile's greatest accepted depth: the input of attributes
    visibility_lanes: int  # lanes that visibility evaluates
    attribute_lanes: int  # lanes that attributes evaluates
    num_pixels: int
    plane_bytes: int  # of a splat's center and tangents
    touched_bytes: int  # of the tiles that a splat touches
    entry_bytes: int  # of an entry of a list
    splat_bytes: int  # of a splat on the device
    record_bytes: int  # of a projected splat
    attribute_bytes: int  # of the attributes of a projected splat
    real_bytes: int


class FramePasses:
    """Runs the passes of one frame one by one, for splats that `renderer` has uploaded."""

    def __init__(self, renderer: Renderer, uploaded: UploadedSplats, camera: Camera, settings: RenderSettings) -> None:
        uploaded = uploaded.prepared(settings)
        settings = effective_settings(settings, uploaded.splats.oriented)
        self._context, self._splats = renderer.pass_inputs(uploaded, camera, settings)
        self._epsilon = uploaded.epsilon(settings)
        self._view = self._context.view(self._splats.origin)

    def run(self, tally: Tally | None = None) -> dict[str, float]:
        """Run a frame; wait for the device after each pass and return the time of each pass, seconds.

        `tally` counts the items of the passes; its time does not count.
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
        """Run a frame and count the items of its passes; slow."""
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
    """Counts over the bands of one frame, for work-items of a whole tile and an epsilon along z."""

    def __init__(self, context: PassContext, num_splats: int, epsilon: float) -> None:
        names = ("num_entries", "num_projected", "num_discs", "num_near", "visibility_lanes", "attribute_lanes")
        self.totals = Counter(dict.fromkeys(names, 0))
        self.listed = np.zeros(num_splats, bool)
        self._context, self._epsilon = context, epsilon

    def add_discs(self, lists: TileLists, projected: ProjectedSplats) -> None:
        """Count the discs of one layer of a band."""
        if not lists.begin[-1]:
            return
        has_disc = self._read(projected.disc_near_z, lists) < np.inf  # False for NaN: no pixels
        records = self._read(projected.records, lists, self._context.dtypes["ProjectedSplat"])
        boxes = np.stack([records[name] for name in BOX], axis=1)
        self.totals.update(
            num_discs=int(np.count_nonzero(has_disc)), visibility_lanes=self._lanes(boxes, lists, has_disc)
        )

    def add_near(self, lists: TileLists, projected: ProjectedSplats, depth: DepthBuffer) -> None:
        """Count the near entries of a band whose depth is complete."""
        if not lists.begin[-1]:
            return
        self.listed[self._ids(lists)] = True
        near_z = self._read(projected.near_z, lists)
        is_near = near_z <= self._farthest(depth)[_tiles(lists)]  # False for NaN: no pixels
        boxes = self._read(projected.boxes, lists, np.dtype((np.int16, 4)))
        self.totals.update(
            num_entries=int(lists.begin[-1]),
            num_projected=int(np.count_nonzero(near_z < np.inf)),
            num_near=int(np.count_nonzero(is_near)),
            attribute_lanes=self._lanes(boxes, lists, is_near),
        )

    def _lanes(self, boxes: NDArray[Any], lists: TileLists, chosen: NDArray[Any]) -> int:
        context = self._context
        return lanes_of(boxes[chosen], _tiles(lists)[chosen], context.tiles_x, context.tile_size, context.lanes)

    def _read(self, buffer: Any, lists: TileLists, dtype: np.dtype[Any] | None = None) -> NDArray[Any]:
        return self._context.device.read(buffer, (int(lists.begin[-1]),), dtype or self._context.real)

    def _ids(self, lists: TileLists) -> NDArray[np.int32]:
        import pyopencl as cl

        ids = np.empty(lists.begin[-1], np.int32)
        cl.enqueue_copy(self._context.device.queue, ids, lists.ids, src_offset=lists.start * ids.itemsize)
        return ids

    def _farthest(self, depth: DepthBuffer) -> NDArray[Any]:
        """Return the (T,) greatest accepted depths of the tiles."""
        context, size = self._context, self._context.tile_size
        image = context.device.read(depth.depth, (context.camera.height, context.camera.width), context.real)
        image = np.pad(image, [(0, -side % size) for side in image.shape], constant_values=-np.inf)
        tiles = image.reshape(-1, size, context.tiles_x, size)
        return (tiles.max(axis=(1, 3)) + context.real.type(self._epsilon)).ravel()


def _tiles(lists: TileLists) -> NDArray[np.int64]:
    """Return the (N,) tiles of the entries."""
    return np.repeat(np.arange(lists.first_tile, lists.last_tile), np.diff(lists.begin))


def lanes_of(boxes: NDArray[Any], tile: NDArray[Any], tiles_x: int, tile_size: int, lanes: int) -> int:
    """Return the number of lanes that a raster pass evaluates for (N, 4) `boxes` of the (N,) `tile`, ascending.

    A batch is `lanes` consecutive boxes of a tile. If all are small, each pixel up to the largest width and height
    takes one vector. Otherwise each box is divided into blocks of `lanes` pixels, from its corner.
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
