"""The binning pass on the device: the splats that may touch each tile (kernels/passes/bin.cl)."""

from __future__ import annotations

from collections.abc import Iterator
from math import gcd
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splatcl.opencl.state.buffers import TileLists
from splatcl.opencl.state.context import PassContext
from splatcl.opencl.state.upload import PLANE_PAD, DeviceSplats

MAX_CHUNKS = 64
"""Most chunks of consecutive splats; each has a count per tile, and one work-item bins it."""
MIN_CHUNK = 1024
"""Least splats per chunk."""
MAX_BAND_RECORDS = 384 << 10
"""Most records of a band of tiles, 43 MB in single precision; one tile alone may need more."""
MAX_LIST_ENTRIES = 128 << 20
"""Most entries of tile lists in memory: 512 MiB, twice that with occlusion keys; one tile alone may need more."""
FRONT_THICKNESS = 2
"""Thickness of a tile's front layer, in widths of the tile at the layer's depth."""


def bin(context: PassContext, view: Any, splats: DeviceSplats) -> Iterator[TileLists]:
    """Yield the lists of the splats that may touch each tile, one band of tiles at a time to bound the memory."""
    device, num_tiles, tiles_x = context.device, context.num_tiles, context.tiles_x
    chunk_size, num_chunks = chunks(splats.num_splats, num_tiles)
    step = _chunk_step(num_chunks)
    layered = int(len(context.layers) > 1)
    options = {"LAYERED": layered, "CENTER_LOW": 0, "ELLIPSE": context.method["ELLIPSE"]}
    listed = device.scratch("listed", splats.num_splats * context.dtypes["TouchedQuarters"].itemsize)
    num_listed = device.scratch("num_listed", num_chunks * 4)
    tile_counts = device.scratch("tile_counts", num_chunks * num_tiles * 4)
    tile_nearest = device.scratch("tile_nearest", layered * num_chunks * num_tiles * 4)
    context.run(
        "bin_count", (num_chunks,), view, splats.center, splats.tangent_u, splats.tangent_v, splats.num_splats,
        splats.stride, step, chunk_size, tiles_x, num_tiles, listed, num_listed, tile_counts, tile_nearest, **options,
    )  # fmt: skip
    totals_buffer, layer_ends = (device.scratch(name, num_tiles * 4) for name in ("tile_totals", "layer_ends"))
    thickness = np.float32(min(FRONT_THICKNESS * context.tile_size / context.camera.fx, 1e30))
    context.run(
        "bin_offsets", (num_tiles,), tile_counts, tile_nearest, num_chunks, num_tiles, thickness, totals_buffer,
        layer_ends, **options,
    )  # fmt: skip
    totals = device.read(totals_buffer, (num_tiles,), np.int32)
    for first, last in bands(totals, MAX_LIST_ENTRIES):
        begin = starts(totals[first:last])
        ids = device.scratch("ids", int(begin[-1]) * 4)
        keys = device.scratch("occlusion_keys", layered * int(begin[-1]) * 4)
        context.run(
            "bin_scatter", (num_chunks,), listed, num_listed, step, chunk_size, tile_counts, context.constant(begin),
            ids, layer_ends, keys, tiles_x, num_tiles, first, last, **options,
        )  # fmt: skip
        for a, b in bands(totals[first:last], MAX_BAND_RECORDS):
            own = begin[a : b + 1] - begin[a]
            yield TileLists(ids, keys, int(begin[a]), own, context.constant(own), first + a, first + b)


def all_splats(context: PassContext, num_splats: int) -> Iterator[TileLists]:
    """List all splats as one tile, in batches. The checks and the probe need each splat exactly once."""
    for start in range(0, max(num_splats, 1), MAX_BAND_RECORDS):
        yield one_tile(context, np.arange(start, min(start + MAX_BAND_RECORDS, num_splats), dtype=np.int32))


def one_tile(context: PassContext, ids: NDArray[np.int32]) -> TileLists:
    """Return the lists of one tile, with the splats `ids`, (E,) in splat order."""
    begin = np.array([0, len(ids)], np.int32)
    return TileLists(context.constant(ids), None, 0, begin, context.constant(begin), 0, 1)


def _chunk_step(num: int) -> int:
    """Return a step, coprime to `num`, that visits all `num` chunks with consecutive ones far apart.

    PoCL gives half of the remaining work-items to the first free core. Neighboring chunks may all be culled, so
    without the step the cores' shares would differ.
    """
    return next(step for step in range(max(num * 5 // 8, 1), 2 * num + 2) if gcd(step, num) == 1)


def chunks(num_splats: int, num_tiles: int) -> tuple[int, int]:
    """Return the number of splats per chunk, a multiple of PLANE_PAD, and the number of chunks."""
    # A chunk has at least as many splats as the image has tiles, so there are no more counts than splats.
    per_chunk = max(-(-num_splats // MAX_CHUNKS), MIN_CHUNK, min(num_tiles, num_splats))
    chunk_size = -(-per_chunk // PLANE_PAD) * PLANE_PAD
    return chunk_size, -(-num_splats // chunk_size)


def starts(lengths: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return the (T + 1,) starts of runs with (T,) `lengths`, and the end of the last."""
    return np.concatenate([[0], np.cumsum(lengths)]).astype(np.int32)


def bands(totals: NDArray[np.int32], max_records: int) -> Iterator[tuple[int, int]]:
    """Cut the tiles into consecutive ranges [first, last) of at most `max_records` records, but at least one tile."""
    ends = np.cumsum(totals, dtype=np.int64)
    first, done = 0, 0
    while first < len(totals):
        last = max(int(np.searchsorted(ends, done + max_records, side="right")), first + 1)
        yield first, last
        first, done = last, int(ends[last - 1])
