"""The visibility pass on the device: depth(p), the nearest disc of each pixel p (kernels/passes/visibility.cl)."""

from __future__ import annotations

from typing import Any

from splatcl.opencl.passes.occlusion import occlusion
from splatcl.opencl.passes.project import project
from splatcl.opencl.state.buffers import DepthBuffer, ProjectedSplats, TileLists
from splatcl.opencl.state.context import BEHIND, EVERY, PassContext
from splatcl.opencl.state.upload import DeviceSplats


def visibility(
    context: PassContext, lists: TileLists, projected: ProjectedSplats, depth: DepthBuffer, layer: int = EVERY
) -> None:
    """Fill the band's part of `depth` with the nearest disc of each pixel, of `layer` and the layers before it."""
    camera = context.camera
    context.run_raster(
        "visibility", lists, projected.records, projected.extra, projected.disc_near_z, lists.ids, lists.start,
        lists.begin_buffer, lists.first_tile, context.tiles_x, context.first_column, context.first_row, camera.width,
        camera.height, camera.near, camera.far, depth.depth, depth.particleid, BEHIND_FRONT=int(layer == BEHIND),
        **projected.options,
    )  # fmt: skip


def project_and_find_depth(
    context: PassContext, view: Any, splats: DeviceSplats, lists: TileLists, depth: DepthBuffer, epsilon: float
) -> ProjectedSplats:
    """Project a band's entries and fill its part of `depth`, layer by layer; return the records of all layers."""
    for layer in context.layers:
        if layer == BEHIND:
            occlusion(context, lists, depth, epsilon)
        projected = project(context, view, splats, lists, layer)
        visibility(context, lists, projected, depth, layer)
    return projected
