"""The splats that touch or nearly touch each tile, on the device in double precision, for margins and envelopes.

Unlike the passes of a frame these need the near misses too, and the culled splats that nearly were not.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from splatcl.passes import Passes
from splatcl.pipeline import bands, chunks, starts
from splatcl.resident import near_origin
from splatcl.splats import Splats

if TYPE_CHECKING:
    from splatcl.device import DeviceQueue

WORLD = ("center", "tangent_u", "tangent_v", "color")
"""What is uploaded of each splat, twelve numbers together."""
VALUES = 7
"""What a fragment adds, the three of its colour and of its normal, and the margin of the normal's sign."""
ENTRIES_PER_ITEM = 256
"""Records that a work-item makes."""
MAX_BAND_RECORDS = {"tile": 16 << 10, "pixel": 1 << 20}
"""Records of one band of tiles: 4 MB that a CPU's cache holds, 250 MB for a GPU; a single tile may need more."""
MAX_LIST_ENTRIES = 2 << 20
"""Entries of the tile lists held together, 208 MiB; a single tile may need more."""
OPTIONS = {"CENTER_LOW": 0, "ENTRIES": ENTRIES_PER_ITEM, "VALUES": VALUES}
"""Build options of kernels/evidence/nearby.cl."""


@dataclass(frozen=True)
class NearbySplats:
    """Records of the tiles [first_tile, last_tile), a run for each tile, in splat order.

    Tile t's run is from tile_begin[t - first_tile] - first_entry to tile_begin[t + 1 - first_tile] - first_entry.
    """

    records: Any
    values: Any
    bounds: Any  # those of the record i are at first_entry + i
    num_records: int
    tile_begin: Any
    first_tile: int
    last_tile: int
    first_entry: int


@dataclass(frozen=True)
class WorldSplats:
    """Splats on the device in double precision, `WORLD` of each, relative to `origin` (world space)."""

    world: Any
    origin: NDArray[np.float64]
    num_splats: int


def upload(device: DeviceQueue, splats: Splats) -> WorldSplats:
    """Copy splats to the device, relative to an origin near them; 96 bytes each."""
    origin = near_origin(splats.center)
    world = np.empty((len(splats), 3 * len(WORLD)))
    for i, name in enumerate(WORLD):
        world[:, 3 * i : 3 * i + 3] = getattr(splats, name)
    world[:, :3] -= origin
    buffer = device.buffer(world.nbytes)
    if len(splats):
        device.write(buffer, world)
    return WorldSplats(buffer, origin, len(splats))


def nearby(passes: Passes, view: Any, splats: WorldSplats) -> Iterator[NearbySplats]:
    """Find each tile's splats, a band of tiles at a time; each overwrites the last (kernels/evidence/nearby.cl)."""
    device, num_tiles, tiles_x, num = passes.device, passes.num_tiles, passes.tiles_x, splats.num_splats
    chunk_size, num_chunks = chunks(num, num_tiles)
    bounds = device.scratch("nearby_bounds", num * 8)
    counts_buffer = device.scratch("nearby_counts", num_chunks * num_tiles * 4)
    passes.run(
        "nearby_count", (num_chunks,), view, splats.world, num, chunk_size, bounds, counts_buffer, tiles_x, num_tiles,
        **OPTIONS,
    )  # fmt: skip
    counts = device.read(counts_buffer, (num_chunks, num_tiles), np.int32)
    totals = counts.sum(axis=0, dtype=np.int32)
    before = counts.cumsum(axis=0, dtype=np.int32) - counts
    for first, last in bands(totals, MAX_LIST_ENTRIES):
        begin = starts(totals[first:last])
        before[:, first:last] += begin[:-1]
        device.write(counts_buffer, before)
        listed = device.scratch("nearby_listed", int(begin[-1]) * 8 * 3 * len(WORLD))
        listed_bounds = device.scratch("nearby_listed_bounds", int(begin[-1]) * 8)
        passes.run(
            "nearby_list", (num_chunks,), splats.world, bounds, num, chunk_size, counts_buffer, listed, listed_bounds,
            tiles_x, num_tiles, first, last, **OPTIONS,
        )  # fmt: skip
        for a, b in bands(totals[first:last], MAX_BAND_RECORDS[device.mapping]):
            yield _records(passes, view, listed, listed_bounds, first + a, begin[a : b + 1])


def _records(
    passes: Passes, view: Any, listed: Any, bounds: Any, first_tile: int, begin: NDArray[np.int32]
) -> NearbySplats:
    """Make the records of a band of tiles, whose lists lie at `begin` of `listed`."""
    device, first, num = passes.device, int(begin[0]), int(begin[-1] - begin[0])
    records = device.scratch("nearby_records", num * passes.dtypes["NearbySplat"].itemsize)
    values = device.scratch("nearby_values", num * VALUES * 8)
    passes.run(
        "nearby_records", (-(-num // ENTRIES_PER_ITEM),), view, listed, bounds, first, num, records, values, **OPTIONS,
    )  # fmt: skip
    return NearbySplats(
        records, values, bounds, num, passes.constant(begin), first_tile, first_tile + len(begin) - 1, first
    )
