"""The passes on the device, one function each, in order: bin, project, visibility, attributes, shade.

Each launches the kernels of the file of the same name in kernels/ and returns a small frozen dataclass.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from math import gcd
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splatcl.lighting import shading_structs
from splatcl.passes import BEHIND, EVERY, PER_FRAGMENT, PER_SPLAT, Passes
from splatcl.resident import PLANE_PAD, ResidentSplats
from splatcl.settings import RenderSettings
from splatcl.shading import resolve as resolve
from splatcl.shading import shade as shade

MAX_CHUNKS = 64
MIN_CHUNK = 1024
ENTRIES_PER_ITEM = 1024
"""Entries of the tile lists that a work-item of the projection takes."""
MAX_BAND_RECORDS = 384 << 10
"""Records of one band of tiles, 43 MB in single precision: a few launches for each; a single tile may need more."""
MAX_LIST_ENTRIES = 128 << 20
"""Entries of the tile lists held together: 512 MiB, twice that with clues; a single tile may need more."""
FRONT_THICKNESS = 2
"""Of a tile's front layer, in widths of the tile."""


@dataclass(frozen=True)
class TileLists:
    """Splats that may touch each tile of the band [first_tile, last_tile), a run for each tile, in splat order.

    The band's entries are `ids[start:start + begin[-1]]`; tile t's among them are from begin[t - first_tile].
    Where there are layers, `clues` says which each is in (kernels/passes/occlusion.h).
    """

    ids: Any
    clues: Any
    start: int
    begin: NDArray[np.int32]
    begin_buffer: Any
    first_tile: int
    last_tile: int


@dataclass(frozen=True)
class ProjectedSplats:
    """A record for each entry of the tile lists, with the pixels of its disc and those of its pre-filter as well.

    `near_z` is a depth that no fragment is nearer than, `disc_near_z` the same for the disc alone and only for this
    layer; NaN where there are no pixels, and where the entry was not projected. `extra` is what methods other than
    [BHZK05]'s need, by the build `options` (kernels/splat/extra.h).
    """

    records: Any
    attributes: Any
    boxes: Any
    disc_near_z: Any
    near_z: Any
    extra: Any
    options: Mapping[str, Any]


@dataclass(frozen=True)
class DepthBuffer:
    """Visibility depth (eye z, +inf where none) and the splat that set it (0xFFFFFFFF none), (H, W)."""

    depth: Any
    particleid: Any


@dataclass(frozen=True)
class GBuffer:
    """Sums over accepted fragments: weight (H, W), color and normal (H, W, 3), depth (H, W), count (H, W)."""

    weight_sum: Any
    color_sum: Any
    normal_sum: Any
    depth_sum: Any
    count: Any


def bin(passes: Passes, view: Any, splats: ResidentSplats) -> Iterator[TileLists]:
    """List the splats that may touch each tile, a band of tiles at a time to bound memory (kernels/passes/bin.cl)."""
    device, num_tiles, tiles_x = passes.device, passes.num_tiles, passes.tiles_x
    chunk_size, num_chunks = chunks(splats.num_splats, num_tiles)
    spread = _spread(num_chunks)
    layered = int(len(passes.layers) > 1)
    options = {"LAYERED": layered, "CENTER_LOW": 0, "ELLIPSE": passes.method["ELLIPSE"]}
    listed = device.scratch("listed", splats.num_splats * passes.dtypes["TouchedQuarters"].itemsize)
    num_listed = device.scratch("num_listed", num_chunks * 4)
    tile_counts = device.scratch("tile_counts", num_chunks * num_tiles * 4)
    tile_nearest = device.scratch("tile_nearest", layered * num_chunks * num_tiles * 4)
    passes.run(
        "bin_count", (num_chunks,), view, splats.center, splats.tangent_u, splats.tangent_v, splats.num_splats,
        splats.stride, spread, chunk_size, tiles_x, num_tiles, listed, num_listed, tile_counts, tile_nearest, **options,
    )  # fmt: skip
    totals_buffer, layer_ends = (device.scratch(name, num_tiles * 4) for name in ("tile_totals", "layer_ends"))
    thickness = np.float32(min(FRONT_THICKNESS * passes.tile_size / passes.camera.fx, 1e30))
    passes.run(
        "bin_offsets", (num_tiles,), tile_counts, tile_nearest, num_chunks, num_tiles, thickness, totals_buffer,
        layer_ends, **options,
    )  # fmt: skip
    totals = device.read(totals_buffer, (num_tiles,), np.int32)
    for first, last in bands(totals, MAX_LIST_ENTRIES):
        begin = starts(totals[first:last])
        ids = device.scratch("ids", int(begin[-1]) * 4)
        clues = device.scratch("clues", layered * int(begin[-1]) * 4)
        passes.run(
            "bin_scatter", (num_chunks,), listed, num_listed, spread, chunk_size, tile_counts, passes.constant(begin),
            ids, layer_ends, clues, tiles_x, num_tiles, first, last, **options,
        )  # fmt: skip
        for a, b in bands(totals[first:last], MAX_BAND_RECORDS):
            own = begin[a : b + 1] - begin[a]
            yield TileLists(ids, clues, int(begin[a]), own, passes.constant(own), first + a, first + b)


def in_order(passes: Passes, num_splats: int) -> Iterator[TileLists]:
    """List all splats as if for one tile, so many at a time: what checks and explains wants every splat once."""
    for start in range(0, max(num_splats, 1), MAX_BAND_RECORDS):
        yield listed(passes, np.arange(start, min(start + MAX_BAND_RECORDS, num_splats), dtype=np.int32))


def listed(passes: Passes, ids: NDArray[np.int32]) -> TileLists:
    """Return given splats as the list of a tile."""
    begin = np.array([0, len(ids)], np.int32)
    return TileLists(passes.constant(ids), None, 0, begin, passes.constant(begin), 0, 1)


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


def hide(passes: Passes, lists: TileLists, depth: DepthBuffer, epsilon: float) -> None:
    """Find the entries behind the front layer, which is in `depth`, that cannot show (kernels/passes/occlusion.cl)."""
    camera = passes.camera
    passes.run(
        "occlusion", (lists.last_tile - lists.first_tile,), lists.clues, lists.start, lists.begin_buffer,
        lists.first_tile, passes.tiles_x, camera.width, camera.height, float(epsilon), depth.depth,
    )  # fmt: skip


def project(passes: Passes, view: Any, splats: ResidentSplats, lists: TileLists, layer: int = EVERY) -> ProjectedSplats:
    """Project, cull and bound the splat of each entry of `layer` that is not hidden (kernels/passes/project.cl)."""
    num_entries = int(lists.begin[-1])
    sizes = {
        "records": passes.dtypes["ProjectedSplat"].itemsize,
        "attributes": passes.dtypes["SplatAttributes"].itemsize,
        "boxes": 8,
        "disc_near_z": passes.real.itemsize,
        "near_z": passes.real.itemsize,
    }
    options: dict[str, Any] = {**passes.method, **splats.options}
    has_extra = any(options[name] for name in ("ELLIPSE", "FIELD", "SHADING", "CLIP", "GLOSS"))
    sizes["extra"] = passes.dtypes["ProjectedExtra"].itemsize if has_extra else 0
    buffers = {name: passes.device.scratch(name, (num_entries + PLANE_PAD) * size) for name, size in sizes.items()}
    structs = shading_structs(passes) if options["SHADING"] == PER_SPLAT else ()
    passes.run(
        "project", (-(-num_entries // ENTRIES_PER_ITEM),), view, splats.splats, splats.center_low or splats.splats,
        splats.extra or splats.splats, lists.ids, lists.clues or lists.ids, lists.start, num_entries, *buffers.values(),
        *structs,
        ENTRIES=ENTRIES_PER_ITEM, CENTER_LOW=int(splats.center_low is not None), LAYER=layer, **options,
    )  # fmt: skip
    return ProjectedSplats(**buffers, options=options)


def bands(totals: NDArray[np.int32], max_records: int) -> Iterator[tuple[int, int]]:
    """Cut the tiles into consecutive ranges of at most `max_records` records, at least one tile each."""
    ends = np.cumsum(totals, dtype=np.int64)
    first, done = 0, 0
    while first < len(totals):
        last = max(int(np.searchsorted(ends, done + max_records, side="right")), first + 1)
        yield first, last
        first, done = last, int(ends[last - 1])


def frame_buffers(passes: Passes) -> tuple[DepthBuffer, GBuffer]:
    """Return the images that the raster passes fill."""
    depth = DepthBuffer(passes.image(), passes.image(dtype="u4"))
    return depth, GBuffer(passes.image(), passes.image(3), passes.image(3), passes.image(), passes.image(dtype="u4"))


def visibility(
    passes: Passes, lists: TileLists, projected: ProjectedSplats, depth: DepthBuffer, layer: int = EVERY
) -> None:
    """Fill the band's part of `depth`: the nearest disc of each pixel (kernels/passes/visibility.cl)."""
    camera = passes.camera
    passes.run_raster(
        "visibility", lists, projected.records, projected.extra, projected.disc_near_z, lists.ids, lists.start,
        lists.begin_buffer, lists.first_tile, passes.tiles_x, passes.first_column, passes.first_row, camera.width,
        camera.height, camera.near, camera.far, depth.depth, depth.particleid, BEHIND_FRONT=int(layer == BEHIND),
        **projected.options,
    )  # fmt: skip


def project_and_see(
    passes: Passes, view: Any, splats: ResidentSplats, lists: TileLists, depth: DepthBuffer, epsilon: float
) -> ProjectedSplats:
    """Project a band's entries and fill its part of `depth`, layer by layer; return the records of them all."""
    for layer in passes.layers:
        if layer == BEHIND:
            hide(passes, lists, depth, epsilon)
        projected = project(passes, view, splats, lists, layer)
        visibility(passes, lists, projected, depth, layer)
    return projected


def attributes(
    passes: Passes,
    view: Any,
    lists: TileLists,
    projected: ProjectedSplats,
    depth: DepthBuffer,
    epsilon: float,
    gbuffer: GBuffer,
) -> None:
    """Fill the band's part of `gbuffer`: fragments within `epsilon` of `depth` (kernels/passes/attributes.cl)."""
    structs = shading_structs(passes) if projected.options["SHADING"] == PER_FRAGMENT else ()
    _run_attributes(
        passes, view, lists, projected, depth, epsilon, projected.records, gbuffer.weight_sum, gbuffer.color_sum,
        gbuffer.normal_sum, gbuffer.depth_sum, gbuffer.count, *structs, CHANNELS=0, **projected.options,
    )  # fmt: skip


def channels(
    passes: Passes,
    view: Any,
    lists: TileLists,
    projected: ProjectedSplats,
    depth: DepthBuffer,
    epsilon: float,
    values: Any,
    images: tuple[Any, Any],
) -> None:
    """Fill the band's part of two (H, W, 3) images: means of six further channels, as `attributes` weighs colours."""
    nothing = passes.device.buffer(0)
    options = {**projected.options, "FIELD": 0, "SHADING": 0, "CHANNELS": 1, "SHADER": '"shading/shaders/albedo.h"'}
    _run_attributes(
        passes, view, lists, projected, depth, epsilon, values, nothing, *images, nothing, nothing, **options
    )


def _run_attributes(
    passes: Passes,
    view: Any,
    lists: TileLists,
    projected: ProjectedSplats,
    depth: DepthBuffer,
    epsilon: float,
    values: Any,
    *images: Any,
    **options: str | int,
) -> None:
    arguments, how = fragment_arguments(passes, epsilon)
    passes.run_raster(
        "attributes", lists, view, projected.records, projected.extra, projected.attributes, projected.boxes,
        projected.near_z, values, lists.ids, lists.start, lists.begin_buffer, lists.first_tile, passes.tiles_x,
        *arguments, depth.depth, *images, **how | options,
    )  # fmt: skip


def fragment_arguments(passes: Passes, epsilon: float) -> tuple[tuple[Any, ...], dict[str, int]]:
    """Return arguments and build options that, with `Passes.method`, say which fragments there are and weigh them."""
    settings = passes.settings
    kernel = {"gaussian": 0, "constant": 1, "table": 2}[settings.kernel]
    kernel += settings.kernel == "table" and settings.kernel_lookup == "linear"
    table = np.array(settings.kernel_table or (0,), passes.real)
    arguments = (
        float(epsilon), settings.along == "ray", -(settings.cutoff**2) / 2, settings.prefilter_radius**-2,
        passes.constant(table), len(table),
    )  # fmt: skip
    return arguments, {"KERNEL": int(kernel), "TARGET": passes.target}


def effective_settings(settings: RenderSettings, oriented: bool) -> RenderSettings:
    """Return the settings for splats whose normals may have no sign: they are turned toward the eye, none is culled."""
    return settings if oriented else replace(settings, facing="flip")
