"""The light map on the device: the lights' contribution for each normal."""

from __future__ import annotations

from typing import Any

from splatcl.opencl.state.context import PassContext
from splatcl.opencl.state.lights import LIGHTMAP_SIZE


def lightmap(context: PassContext, structs: tuple[Any, Any]) -> Any:
    """Return the light map on the device, (LIGHTMAP_SIZE, LIGHTMAP_SIZE, 6) real (kernels/passes/lightmap.cl).

    `structs` are those of `shading_structs`.
    """
    table = context.device.buffer(LIGHTMAP_SIZE**2 * 6 * context.real.itemsize)
    size = (-(-LIGHTMAP_SIZE // context.lanes), LIGHTMAP_SIZE)
    context.run("lightmap", size, *structs, table, LIGHTMAP=LIGHTMAP_SIZE)
    return table
