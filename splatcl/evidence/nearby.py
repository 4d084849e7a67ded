"""Lists of the splats that touch or nearly touch each tile, for margins and envelopes (kernels/evidence/nearby.cl).

They are made on the device, in double precision. Unlike the frame's lists, they include near misses, and culled splats
that nearly were not culled.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splatcl.errors import DeviceError
from splatcl.opencl.device.strictness import Device
from splatcl.opencl.passes.bin import bands, chunks, starts
from splatcl.opencl.session import Session, UploadedSplats
from splatcl.opencl.state.context import PassContext
from splatcl.opencl.state.upload import near_origin
from splatcl.scene.camera import Camera
from splatcl.scene.settings import RenderSettings
from splatcl.scene.splats import Splats

TILE = 8
"""Side of a tile, pixels; bits do not depend on it."""
WORLD = ("center", "tangent_u", "tangent_v", "color")
"""Fields of a splat that are uploaded: twelve numbers, one after another."""
VALUES = 7
"""Values per record: color (3) and normal (3) of its fragments, and the margin of the normal's sign."""
ENTRIES_PER_ITEM = 256
"""Records that one work-item makes."""
MAX_BAND_RECORDS = {"tile": 16 << 10, "pixel": 1 << 20}
"""Most records of a band: 4 MB to fit a CPU's cache, 250 MB for a GPU; one tile alone may need more."""
MAX_LIST_ENTRIES = 2 << 20
"""Most entries of tile lists in memory, 208 MiB; one tile alone may need more."""
OPTIONS = {"CENTER_LOW": 0, "ENTRIES": ENTRIES_PER_ITEM, "VALUES": VALUES}
"""Build options of kernels/evidence/nearby.cl."""


@dataclass(frozen=True)
class NearbySplats:
    """Records of a band of T tiles with E entries: one run per tile, in splat order.

    Tile t's run is from tile_begin[t - first_tile] - first_entry to tile_begin[t + 1 - first_tile] - first_entry.
    """

    records: Any  # (E,) NearbySplat
    values: Any  # (E, VALUES) float64
    bounds: Any  # (first_entry + E, 4) or more, int16 pixels; record i's are at first_entry + i
    num_records: int  # E
    tile_begin: Any  # (T + 1,) int32
    first_tile: int  # row-major index
    last_tile: int  # row-major index, exclusive
    first_entry: int


@dataclass(frozen=True)
class WorldSplats:
    """Splats on the device in double precision, world space."""

    world: Any  # (N, 12) float64: the fields `WORLD`, the center relative to `origin`
    origin: NDArray[np.float64]  # (3,)
    num_splats: int


def upload(device: Device, splats: Splats) -> WorldSplats:
    """Copy splats to the device, relative to `near_origin`; 96 bytes each."""
    origin = near_origin(splats.center)
    world = np.empty((len(splats), 3 * len(WORLD)))
    for i, name in enumerate(WORLD):
        world[:, 3 * i : 3 * i + 3] = getattr(splats, name)
    world[:, :3] -= origin
    buffer = device.buffer(world.nbytes)
    if len(splats):
        device.write(buffer, world)
    return WorldSplats(buffer, origin, len(splats))


def nearby(context: PassContext, view: Any, splats: WorldSplats) -> Iterator[NearbySplats]:
    """Yield the records of each tile's splats, one band of tiles at a time; each band overwrites the last one's."""
    device, num_tiles, tiles_x, num = context.device, context.num_tiles, context.tiles_x, splats.num_splats
    chunk_size, num_chunks = chunks(num, num_tiles)
    bounds = device.scratch("nearby_bounds", num * 8)
    counts_buffer = device.scratch("nearby_counts", num_chunks * num_tiles * 4)
    context.run(
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
        context.run(
            "nearby_list", (num_chunks,), splats.world, bounds, num, chunk_size, counts_buffer, listed, listed_bounds,
            tiles_x, num_tiles, first, last, **OPTIONS,
        )  # fmt: skip
        for a, b in bands(totals[first:last], MAX_BAND_RECORDS[device.mapping]):
            yield _records(context, view, listed, listed_bounds, first + a, begin[a : b + 1])


def _records(
    context: PassContext, view: Any, listed: Any, bounds: Any, first_tile: int, begin: NDArray[np.int32]
) -> NearbySplats:
    """Make the records of a band of tiles; `begin`, (T + 1,), are the starts of its runs in `listed`."""
    device, first, num = context.device, int(begin[0]), int(begin[-1] - begin[0])
    records = device.scratch("nearby_records", num * context.dtypes["NearbySplat"].itemsize)
    values = device.scratch("nearby_values", num * VALUES * 8)
    context.run(
        "nearby_records", (-(-num // ENTRIES_PER_ITEM),), view, listed, bounds, first, num, records, values, **OPTIONS,
    )  # fmt: skip
    return NearbySplats(
        records, values, bounds, num, context.constant(begin), first_tile, first_tile + len(begin) - 1, first
    )


def double_context(session: Session, camera: Camera, settings: RenderSettings) -> PassContext:
    """Return the context of the kernels of margins and envelopes, in double precision."""
    return PassContext(session.device, camera, settings, TILE, "double")


def draws_discs(uploaded: UploadedSplats, settings: RenderSettings) -> bool:
    """Return True if the splats are whole ray-cast discs without clip lines, with the center's depth beside the disc.

    The kernels support no other.
    """
    usual_depth = settings.prefilter != "min" or settings.filter_depth == "center"
    whole = settings.sprite == "exact" and uploaded.splats.clip is None
    return settings.footprint == "raycast" and whole and usual_depth


def has_strict_double(session: Session) -> bool:
    """Return True if the session's device has double precision, and every operation of it is correctly rounded."""
    if not session.supports_double:
        return False
    strictness = session.device.strictness
    try:
        strictness.options("double")
    except DeviceError:
        return False
    return not strictness.reason("double")


def world_splats(session: Session, uploaded: UploadedSplats) -> WorldSplats:
    """Return the splats on the session's device in double precision, uploaded once."""
    splats: WorldSplats = uploaded.on(session.device, "nearby", lambda: upload(session.device, uploaded.splats))
    return splats
