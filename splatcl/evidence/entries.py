"""The entries that tile lists must have, from the splats that the projection keeps, and the faults of given lists."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splatcl.opencl.passes.bin import all_splats
from splatcl.opencl.passes.project import project
from splatcl.opencl.state.buffers import ProjectedSplats, TileLists
from splatcl.opencl.state.context import PassContext
from splatcl.opencl.state.upload import DeviceSplats

Array = NDArray[Any]


@dataclass(frozen=True)
class Projected:
    """Splats that the projection keeps, in splat order, or the entries of a band."""

    ids: Array  # (S,) uint32 splat indices
    records: Array  # (S,) ProjectedSplat
    attributes: Array  # (S,) SplatAttributes
    boxes: Array  # (S, 4) int16 x_min y_min x_max y_max of footprint and pre-filter, whole pixels, ends included

    @classmethod
    def read(cls, context: PassContext, lists: TileLists, projected: ProjectedSplats) -> Projected:
        """Read the records of each entry of the lists."""
        device, dtypes, num = context.device, context.dtypes, int(lists.begin[-1])
        ids = device.read(lists.ids, (lists.start + num,), np.uint32)[lists.start :]
        records = device.read(projected.records, (num,), dtypes["ProjectedSplat"])
        attributes = device.read(projected.attributes, (num,), dtypes["SplatAttributes"])
        return cls(ids, records, attributes, device.read(projected.boxes, (num, 4), np.int16))

    def take(self, where: Array) -> Projected:
        """Return the rows at indices, or of a mask."""
        return Projected(*(getattr(self, field.name)[where] for field in fields(self)))


@dataclass(frozen=True)
class Entries:
    """Entries that the tile lists must have, by tile and then by splat."""

    tile: Array  # (C,) row-major index
    row: Array  # (C,) row of the splat in `Projected`


def project_in_order(context: PassContext, view: Any, splats: DeviceSplats) -> Projected:
    """Project every splat, without tiles; return the splats that touch a pixel."""
    parts = []
    for lists in all_splats(context, splats.num_splats):
        part = Projected.read(context, lists, project(context, view, splats, lists))
        parts.append(part.take(part.boxes[:, 0] <= part.boxes[:, 2]))
    return Projected(*(np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(Projected)))


def expected_entries(kept: Projected, tile_size: int, tiles_x: int) -> Entries:
    """Return an entry for each kept splat and each tile that its bounds touch."""
    x, y, x_last, y_last = (kept.boxes // tile_size).astype(np.int64).T
    across = x_last - x + 1
    num_tiles = across * (y_last - y + 1)
    row = np.repeat(np.arange(len(num_tiles)), num_tiles)
    nth = np.arange(len(row)) - np.repeat(np.cumsum(num_tiles) - num_tiles, num_tiles)
    tile = (y[row] + nth // across[row]) * tiles_x + x[row] + nth % across[row]
    order = np.argsort(tile, kind="stable")
    return Entries(tile[order], row[order])


def list_faults(
    context: PassContext, kept: Projected, entries: Entries, lists: TileLists, projected: ProjectedSplats
) -> Iterator[str]:
    """Yield the faults of a band's lists: wrong order, missing splats, or wrong records."""
    got = Projected.read(context, lists, projected)
    tile = np.repeat(np.arange(lists.first_tile, lists.last_tile), np.diff(lists.begin))
    key = (tile.astype(np.int64) << 32) + got.ids
    ends = np.searchsorted(entries.tile, (lists.first_tile, lists.last_tile))
    tile, row = entries.tile[slice(*ends)], entries.row[slice(*ends)]
    expected_key = (tile.astype(np.int64) << 32) + kept.ids[row]
    if not (np.diff(key) > 0).all():
        yield f"order in tiles {lists.first_tile} to {lists.last_tile - 1}"
        return
    at = np.minimum(np.searchsorted(key, expected_key), max(len(key) - 1, 0))
    missing = key[at] != expected_key if len(key) else np.ones(len(expected_key), bool)
    if missing.any():
        yield f"{np.count_nonzero(missing)} splats not listed, the first in tile {tile[int(missing.argmax())]}"
        return
    expected, got = kept.take(row), got.take(at)
    for name in ("records", "attributes", "boxes"):
        wrong = _differ(getattr(got, name), getattr(expected, name))
        if wrong.any():
            yield f"{np.count_nonzero(wrong)} {name}, the first in tile {tile[int(wrong.argmax())]}"


def _differ(a: Array, b: Array) -> Array:
    """Return (N,) bool: True if any bit of a row differs; padding does not count."""
    if a.dtype.names:
        columns = [(a[name], b[name]) for name in a.dtype.names if name != "pad"]
    else:
        columns = list(zip(a.T, b.T, strict=True))
    return np.logical_or.reduce([_bits(x) != _bits(y) for x, y in columns])


def _bits(values: Array) -> Array:
    return np.ascontiguousarray(values).view(f"u{values.itemsize}")
