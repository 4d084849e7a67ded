"""The passes on the device, one function each, in order: bin, project, visibility, attributes, shade.

Each launches the kernels of the file of the same name in kernels/ and returns a small frozen dataclass.
"""

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
MIN_CHUNK = 1024
MAX_BAND_RECORDS = 384 << 10
"""Records of one band of tiles, 43 MB in single precision: a few launches for each; a single tile may need more."""
MAX_LIST_ENTRIES = 128 << 20
"""Entries of the tile lists held together: 512 MiB, twice that with clues; a single tile may need more."""
FRONT_THICKNESS = 2
"""Of a tile's front layer, in widths of the tile."""


def bin(context: PassContext, view: Any, splats: DeviceSplats) -> Iterator[TileLists]:
    """List the splats that may touch each tile, a band of tiles at a time to bound memory (kernels/bin.cl)."""
    device, num_tiles, tiles_x = context.device, context.num_tiles, context.tiles_x
    chunk_size, num_chunks = chunks(splats.num_splats, num_tiles)
    spread = _spread(num_chunks)
    layered = int(len(context.layers) > 1)
    options = {"LAYERED": layered, "CENTER_LOW": 0, "ELLIPSE": context.method["ELLIPSE"]}
    listed = device.scratch("listed", splats.num_splats * context.dtypes["TouchedQuarters"].itemsize)
    num_listed = device.scratch("num_listed", num_chunks * 4)
    tile_counts = device.scratch("tile_counts", num_chunks * num_tiles * 4)
    tile_nearest = device.scratch("tile_nearest", layered * num_chunks * num_tiles * 4)
    context.run(
        "bin_count", (num_chunks,), view, splats.center, splats.tangent_u, splats.tangent_v, splats.num_splats,
        splats.stride, spread, chunk_size, tiles_x, num_tiles, listed, num_listed, tile_counts, tile_nearest, **options,
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
        keys = device.scratch("clues", layered * int(begin[-1]) * 4)
        context.run(
            "bin_scatter", (num_chunks,), listed, num_listed, spread, chunk_size, tile_counts, context.constant(begin),
            ids, layer_ends, keys, tiles_x, num_tiles, first, last, **options,
        )  # fmt: skip
        for a, b in bands(totals[first:last], MAX_BAND_RECORDS):
            own = begin[a : b + 1] - begin[a]
            yield TileLists(ids, keys, int(begin[a]), own, context.constant(own), first + a, first + b)


def in_order(context: PassContext, num_splats: int) -> Iterator[TileLists]:
    """List all splats as if for one tile, so many at a time: what checks and explains wants every splat once."""
    for start in range(0, max(num_splats, 1), MAX_BAND_RECORDS):
        yield listed(context, np.arange(start, min(start + MAX_BAND_RECORDS, num_splats), dtype=np.int32))


def listed(context: PassContext, ids: NDArray[np.int32]) -> TileLists:
    """Return given splats as the list of a tile."""
    begin = np.array([0, len(ids)], np.int32)
    return TileLists(context.constant(ids), None, 0, begin, context.constant(begin), 0, 1)


def _spread(num: int) -> int:
    """Return a step that visits all of `num` chunks, each far from the one before.

    PoCL gives half of what is left to the first free core, and neighbouring chunks may all be culled, or none.
    """
    return next(step for step in range(max(num * 5 // 8, 1), 2 * num + 2) if gcd(step, num) == 1)


def chunks(num_splats: int, num_tiles: int) -> tuple[int, int]:
    """Return how many splats a chunk has, for a count of each tile's, and how many chunks there are."""
    # No more counts than splats, where the image is large.
    per_chunk = max(-(-num_splats // MAX_CHUNKS), MIN_CHUNK, min(num_tiles, num_splats))
    chunk_size = -(-per_chunk // PLANE_PAD) * PLANE_PAD
    return chunk_size, -(-num_splats // chunk_size)


def starts(lengths: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return where each run of a list begins, and where the last one ends."""
    return np.concatenate([[0], np.cumsum(lengths)]).astype(np.int32)


def bands(totals: NDArray[np.int32], max_records: int) -> Iterator[tuple[int, int]]:
    """Cut the tiles into consecutive ranges of at most `max_records` records, at least one tile each."""
    ends = np.cumsum(totals, dtype=np.int64)
    first, done = 0, 0
    while first < len(totals):
        last = max(int(np.searchsorted(ends, done + max_records, side="right")), first + 1)
        yield first, last
        first, done = last, int(ends[last - 1])
