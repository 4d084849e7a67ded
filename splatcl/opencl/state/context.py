"""The context of one frame's passes: device, camera, settings and tile grid; it builds and runs their kernels."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from splatcl.opencl.device.program import file_of
from splatcl.opencl.device.strictness import Device
from splatcl.opencl.device.structs import REAL_CODES, structs
from splatcl.opencl.state.buffers import DepthBuffer, GBuffer, TileLists
from splatcl.scene.camera import Camera, rotated
from splatcl.scene.settings import Precision, RenderSettings

PIXEL_GROUP = 64
"""Work-items per group when each takes one pixel. It must divide the pixels of the smallest tile."""
FEW_TILES, MANY_ENTRIES = 8, 4096
"""A band with fewer tiles than `FEW_TILES`, and more than `MANY_ENTRIES` entries per tile, gets smaller work-items."""
FOOTPRINTS = {"raycast": 0, "affine": 1, "conic": 2}
PREFILTERS = {"none": 0, "min": 1, "ewa": 2}
FILTER_DEPTHS = {"center": 0, "plane": 1, "front": 2}
DEFERRED, PER_FRAGMENT, PER_SPLAT = 0, 1, 2
SHADING = {"deferred": DEFERRED, "fragment": PER_FRAGMENT, "splat": PER_SPLAT}
TARGETS = {"float16": 1, "unorm8": 2, "float16_clamped": 4}
"""Values of the kernels' build options (kernels/splat/extra.h, kernels/splat/target.h)."""
PREFILTER_CENTERS = {"projected": 0, "bounds": 1, "parallelogram": 2}
FACING = {"keep": 0, "flip": 1, "cull": 2}
EVERY, FRONT, BEHIND = 0, 1, 2
"""Layers of a tile's list: every entry; the entries near the tile's nearest; the others that these do not occlude."""


def shader_header(shader: str) -> str:
    """Return the value of the build option SHADER: the header of `shader` in kernels/."""
    return f'"shading/shaders/{shader}.h"'


class PassContext:
    """Device, camera, settings and tile grid of one frame's passes.

    The frame may be a window of a larger image. `first` is then the column and row of the window's first pixel. The
    camera's width and height are the window's; its principal point is that of the larger image.
    """

    def __init__(
        self,
        device: Device,
        camera: Camera,
        settings: RenderSettings,
        tile_size: int,
        precision: Precision,
        first: tuple[int, int] = (0, 0),
    ) -> None:
        self.device, self.camera, self.settings, self.tile_size = device, camera, settings, tile_size
        self.first_column, self.first_row = first
        self.precision, self.real = precision, np.dtype(REAL_CODES[precision])
        self.dtypes, self.declarations = structs(REAL_CODES[precision])
        self.lanes = device.lanes_of(self.real)
        self.tiles_x = -(-camera.width // tile_size)
        self.num_tiles = self.tiles_x * -(-camera.height // tile_size)
        self.num_pixels = camera.width * camera.height
        self.method: dict[str, Any] = {
            "ELLIPSE": FOOTPRINTS[settings.footprint],
            "PREFILTER": PREFILTERS[settings.prefilter],
            "FILTER_DEPTH": FILTER_DEPTHS[settings.filter_depth] if settings.prefilter == "min" else 0,
            "POINT": int(settings.sprite == "point"),
            "FIELD": int(settings.normals == "field"),
            "SHADING": SHADING[settings.shading],
            "SHADER": shader_header("albedo" if settings.shading == "deferred" else settings.shader),
        }
        # Back-face culling already removes most hidden splats of a closed surface, so layers would not pay. The bin
        # pass bounds the depths of the disc and the center alone.
        self.layers = (EVERY,) if settings.facing == "cull" or self.method["FILTER_DEPTH"] else (FRONT, BEHIND)

    def run(self, kernel: str, size: tuple[int, ...], *args: Any, group: int = 1, **options: str | int) -> None:
        """Run `kernel` (`program.file_of` finds its file), built for this frame, over `size` work-items.

        Python integers become int; Python floats become the frame's real.
        """
        common = {
            "LANES": self.lanes,
            "DOUBLE": int(self.real == np.float64),
            "TILE": self.tile_size,
            **self.device.strictness.options(self.precision),
            "ORTHOGRAPHIC": int(self.camera.projection == "orthographic"),
        }
        converted = [
            np.int32(a) if isinstance(a, int) else self.real.type(a) if isinstance(a, float) else a for a in args
        ]
        program = self.device.program(file_of(kernel), self.declarations, **(common | options))
        program(self.device.queue, kernel, size, group, *converted)

    def run_raster(self, kernel: str, lists: TileLists, *args: Any, **options: str | int) -> None:
        """Run a raster pass over a band's tiles, with a work-item per tile or per pixel.

        If few tiles hold many splats, a work-item takes a quarter of a tile, so that all cores have work.
        """
        num_tiles, group, region = lists.last_tile - lists.first_tile, 1, self.tile_size
        if self.device.mapping == "pixel":
            group, region = PIXEL_GROUP, 1
        elif num_tiles < FEW_TILES and lists.begin[-1] > MANY_ENTRIES * num_tiles:
            region = self.tile_size // 2
        size = num_tiles * (self.tile_size // region) ** 2
        self.run(kernel, (size,), *args, group=group, REGION=region, **options)

    @property
    def target(self) -> int:
        """Number of the type that sums are rounded to (kernels/splat/target.h); 0 for the frame's real."""
        narrower = self.settings.target == "float32" and self.real == np.float64
        return 3 if narrower else TARGETS.get(self.settings.target, 0)

    def image(self, channels: int = 1, dtype: Any = None) -> Any:
        """Return an image buffer (H, W, channels) with undefined content; `dtype` is the frame's real by default."""
        return self.device.image(self.num_pixels, channels * np.dtype(dtype or self.real).itemsize)

    def constant(self, array: NDArray[Any]) -> Any:
        """Return a read-only buffer on the device with a copy of `array`."""
        import pyopencl as cl

        if not array.size:
            return self.device.buffer(0)
        flags = cl.mem_flags.READ_ONLY | cl.mem_flags.COPY_HOST_PTR
        return cl.Buffer(self.device.context, flags, hostbuf=np.ascontiguousarray(array))

    def view(self, origin: NDArray[np.float64]) -> Any:
        """Return the View struct on the device: the camera for world coordinates relative to `origin`, (3,) float64.

        The fields of the view transform have a high and a low part, so they have twice the precision.
        """
        camera, view = self.camera, np.zeros(1, self.dtypes["View"])
        rotation = camera.eye_from_world[:3, :3]
        translation = camera.eye_from_world[:3, 3] + rotated(rotation, origin)
        exact = {f"r{i}{j}": rotation[i, j] for i in range(3) for j in range(3)}
        exact |= {f"t{i}": translation[i] for i in range(3)}
        exact |= {"fx": camera.fx, "fy": camera.fy, "cx": camera.cx - 0.5, "cy": camera.cy - 0.5}
        for name, value in exact.items():
            view[f"{name}_hi"] = value
            view[f"{name}_lo"] = value - view[f"{name}_hi"].astype(np.float64)
        view["reach"] = np.abs(translation).sum()
        view["near"], view["far"] = camera.near, camera.far
        view["prefilter_radius"] = self.settings.prefilter_radius
        view["first_column"], view["first_row"] = self.first_column, self.first_row
        view["width"], view["height"] = camera.width, camera.height
        view["facing"] = FACING[self.settings.facing]
        view["prefilter"] = self.settings.prefilter == "min"
        if self.settings.prefilter == "ewa":
            view["low_pass_reach"] = self.settings.cutoff * self.settings.prefilter_radius
            view["low_pass"] = (self.settings.cutoff * self.settings.prefilter_radius) ** 2
        view["prefilter_center"] = PREFILTER_CENTERS[self.settings.prefilter_center]
        return self.constant(view)


def frame_buffers(context: PassContext) -> tuple[DepthBuffer, GBuffer]:
    """Return the images that the raster passes fill, with undefined content."""
    depth = DepthBuffer(context.image(), context.image(dtype="u4"))
    return depth, GBuffer(
        context.image(), context.image(3), context.image(3), context.image(), context.image(dtype="u4")
    )
