"""The projection pass on the device: a record for each entry of the tile lists (kernels/passes/project.cl)."""

from __future__ import annotations

from typing import Any

from splatcl.opencl.state.buffers import ProjectedSplats, TileLists
from splatcl.opencl.state.context import EVERY, PER_SPLAT, PassContext
from splatcl.opencl.state.lights import shading_structs
from splatcl.opencl.state.upload import PLANE_PAD, DeviceSplats

ENTRIES_PER_ITEM = 1024
"""Entries that one work-item of the projection takes."""


def project(
    context: PassContext, view: Any, splats: DeviceSplats, lists: TileLists, layer: int = EVERY
) -> ProjectedSplats:
    """Project, cull and bound the splat of each entry of `layer` that is not occluded."""
    num_entries = int(lists.begin[-1])
    sizes = {
        "records": context.dtypes["ProjectedSplat"].itemsize,
        "attributes": context.dtypes["SplatAttributes"].itemsize,
        "boxes": 8,
        "disc_near_z": context.real.itemsize,
        "near_z": context.real.itemsize,
    }
    options: dict[str, Any] = {**context.method, **splats.options}
    has_extra = any(options[name] for name in ("ELLIPSE", "FIELD", "SHADING", "CLIP", "GLOSS"))
    sizes["extra"] = context.dtypes["ProjectedExtra"].itemsize if has_extra else 0
    buffers = {name: context.device.scratch(name, (num_entries + PLANE_PAD) * size) for name, size in sizes.items()}
    structs = shading_structs(context) if options["SHADING"] == PER_SPLAT else ()
    context.run(
        "project", (-(-num_entries // ENTRIES_PER_ITEM),), view, splats.splats, splats.center_low or splats.splats,
        splats.extra or splats.splats, lists.ids, lists.keys or lists.ids, lists.start, num_entries, *buffers.values(),
        *structs,
        ENTRIES=ENTRIES_PER_ITEM, CENTER_LOW=int(splats.center_low is not None), LAYER=layer, **options,
    )  # fmt: skip
    return ProjectedSplats(**buffers, options=options)
