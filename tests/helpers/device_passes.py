"""The passes of splatcl.opencl, one by one, with every intermediate result as arrays."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from splatcl import oracle
from splatcl.opencl.passes import bin as bin_pass
from splatcl.opencl.passes.attributes import attributes
from splatcl.opencl.passes.project import project
from splatcl.opencl.passes.shade import resolve, shade
from splatcl.opencl.passes.visibility import project_and_find_depth
from splatcl.opencl.state.buffers import Band, DepthBuffer, GBuffer, Raster
from splatcl.opencl.state.context import PassContext, frame_buffers
from splatcl.opencl.state.upload import upload
from splatcl.scene.settings import effective_settings

BOX = ("x_min", "y_min", "x_max", "y_max")


@dataclass(frozen=True)
class Runs:
    """The records of one tile, in the order of its list."""

    records: np.ndarray
    attributes: np.ndarray


class DevicePasses:
    """The passes of one frame on one device. Call the methods in the order of the passes."""

    def __init__(self, device, splats, camera, settings, tile_size=16):
        settings = effective_settings(settings, splats.oriented)
        self.epsilon = oracle.auto_epsilon(splats) if settings.epsilon == "auto" else settings.epsilon
        self.device, self.camera, self.settings = device, camera, settings
        self.passes = PassContext(device, camera, settings, tile_size, settings.precision)
        self.splats = upload(device, splats, settings.precision)
        self.view = self.passes.view(self.splats.origin)

    def project(self):
        """Return the records and attributes of the splats that touch a pixel, in splat order.

        The fields of `records` are those of ProjectedSplat and `id`. Their bounds include the pre-filter.
        """
        parts = [self.read(lists) for lists in bin_pass.all_splats(self.passes, self.splats.num_splats)]
        records, attributes = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
        drawn = records["x_min"] <= records["x_max"]
        return records[drawn], attributes[drawn]

    def bin(self):
        """Return `Runs` for each tile in row-major order, and the (first, last) tiles of each band."""
        runs, bands = [], []
        for lists in bin_pass.bin(self.passes, self.view, self.splats):
            begin = self.device.read(lists.begin_buffer, lists.begin.shape, np.int32)
            np.testing.assert_array_equal(begin, lists.begin)
            read = self.read(lists)
            runs += [Runs(*(array[a:b] for array in read)) for a, b in pairwise(begin)]
            bands.append((lists.first_tile, lists.last_tile))
        return runs, bands

    def read(self, lists):
        """Return the record and attributes of each entry of the lists."""
        num, read, dtypes = int(lists.begin[-1]), self.device.read, self.passes.dtypes
        p = project(self.passes, self.view, self.splats, lists)
        projected = read(p.records, (num,), dtypes["ProjectedSplat"])
        names = [name for name in projected.dtype.names if name != "pad"]
        records = np.zeros(num, [("id", "u4"), *((name, projected.dtype[name]) for name in names)])
        for name in names:
            records[name] = projected[name]
        records["id"] = read(lists.ids, (lists.start + num,), np.uint32)[lists.start :]
        for name, column in zip(BOX, read(p.boxes, (num, 4), np.int16).T, strict=True):
            records[name] = column
        return records, read(p.attributes, (num,), dtypes["SplatAttributes"])

    def raster(self):
        """Run the passes up to the attribute pass; return its outputs by the names of the dataclasses' fields."""
        depth, gbuffer = frame_buffers(self.passes)
        for lists in bin_pass.bin(self.passes, self.view, self.splats):
            projected = project_and_find_depth(self.passes, self.view, self.splats, lists, depth, self.epsilon)
            attributes(self.passes, Band(self.view, lists, projected, depth, self.epsilon), gbuffer)
        return {name: self._image(name, value) for name, value in (vars(depth) | vars(gbuffer)).items()}

    def shade(self, sums):
        """Shade and resolve the test's own G-buffer; `sums` has the names of the dataclasses' fields."""
        buffers = {name: self.passes.constant(array.astype(self.passes.real)) for name, array in sums.items()}
        depth = DepthBuffer(buffers.pop("depth"), None)
        gbuffer = GBuffer(**buffers, count=None)
        raster = Raster(self.view, depth, gbuffer, self.epsilon)
        color = shade(self.passes, raster)
        resolved = resolve(self.passes, raster)
        return {"color": self._image("color", color, 4)} | {
            name: self._image(name, buffer) for name, buffer in resolved.items()
        }

    def _image(self, name, buffer, channels=None):
        vectors = ("color_sum", "normal_sum", "P", "N", "albedo")
        channels = channels or (3 if name in vectors else 1)
        dtype = np.dtype("u4") if name in ("particleid", "count") else self.passes.real
        size = (self.camera.height, self.camera.width)
        return self.device.read(buffer, size if channels == 1 else (*size, channels), dtype)
