"""Occlusion culling on the device: entries behind a tile's front layer that cannot show are skipped."""

from __future__ import annotations

from splatcl.opencl.state.buffers import DepthBuffer, TileLists
from splatcl.opencl.state.context import PassContext


def occlusion(context: PassContext, lists: TileLists, depth: DepthBuffer, epsilon: float) -> None:
    """Mark the entries of `lists` that `depth` occludes, in their occlusion keys (kernels/passes/occlusion.cl).

    `depth` holds the front layer. No bit of the image changes: an entry that may show stays.
    """
    camera = context.camera
    context.run(
        "occlusion", (lists.last_tile - lists.first_tile,), lists.keys, lists.start, lists.begin_buffer,
        lists.first_tile, context.tiles_x, camera.width, camera.height, float(epsilon), depth.depth,
    )  # fmt: skip
