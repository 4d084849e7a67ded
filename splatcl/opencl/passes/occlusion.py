"""Occlusion culling on the device: entries that nearer splats of their tile hide are passed over."""

from __future__ import annotations

from splatcl.opencl.state.buffers import DepthBuffer, TileLists
from splatcl.opencl.state.context import PassContext


def occlusion(context: PassContext, lists: TileLists, depth: DepthBuffer, epsilon: float) -> None:
    """Find the entries behind the front layer, which is in `depth`, that cannot show (kernels/hide.cl)."""
    camera = context.camera
    context.run(
        "occlusion", (lists.last_tile - lists.first_tile,), lists.keys, lists.start, lists.begin_buffer,
        lists.first_tile, context.tiles_x, camera.width, camera.height, float(epsilon), depth.depth,
    )  # fmt: skip
