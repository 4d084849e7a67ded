"""The pipeline of splatcl.render, pass by pass, with every intermediate read back as arrays."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from splatcl import oracle, pipeline
from splatcl.pipeline import DepthBuffer, GBuffer, Passes
from splatcl.resident import upload


@dataclass(frozen=True)
class Runs:
    """Records of one tile, as the raster passes stream them."""

    records: np.ndarray
    attributes: np.ndarray


class DevicePasses:
    """One frame's passes on one device. Call the methods in the order of the passes."""

    def __init__(self, device, splats, camera, settings, tile_size=16):
        settings = pipeline.effective_settings(settings, splats.oriented)
        self.epsilon = oracle.auto_epsilon(splats) if settings.epsilon == "auto" else settings.epsilon
        self.device, self.camera, self.settings = device, camera, settings
        self.passes = Passes(device, camera, settings, tile_size, settings.precision)
        self.splats = upload(device, splats, settings.precision)
        self.view = self.passes.view(self.splats.origin)

    def project(self):
        """Return the surviving records and their attributes, in the order they were written."""
        self._projected = p = pipeline.project(self.passes, self.view, self.splats)
        survivors = self.device.read(p.num_survivors, (p.num_chunks,), np.int32)
        places = [np.arange(n) + chunk * p.chunk_size for chunk, n in enumerate(survivors)]
        places = np.concatenate([np.zeros(0, np.int64), *places])
        return tuple(
            self.device.read(buffer, (self.splats.num_splats,), self.passes.dtypes[name])[places]
            for buffer, name in ((p.records, "ProjectedSplat"), (p.attributes, "SplatAttributes"))
        )

    def bin(self):
        """Return `Runs` for each tile in row-major order, and the bands they were made in."""
        runs, bands = [], []
        for lists in pipeline.bin(self.passes, self._projected):
            begin = self.device.read(lists.begin_buffer, lists.begin.shape, np.int32)
            np.testing.assert_array_equal(begin, lists.begin)
            read = [
                self.device.read(buffer, (int(begin[-1]),), self.passes.dtypes[name])
                for buffer, name in ((lists.records, "ProjectedSplat"), (lists.attributes, "SplatAttributes"))
            ]
            runs += [Runs(*(array[a:b] for array in read)) for a, b in pairwise(begin)]
            bands.append((lists.first_tile, lists.last_tile))
        return runs, bands

    def raster(self):
        """Run everything up to the attribute pass; return its outputs by the names of the dataclasses' fields."""
        image, u4 = self.passes.image, np.dtype("u4")
        depth = DepthBuffer(image(), image(dtype=u4))
        gbuffer = GBuffer(image(), image(3), image(3), image(), image(dtype=u4))
        projected = pipeline.project(self.passes, self.view, self.splats)
        for lists in pipeline.bin(self.passes, projected):
            pipeline.visibility(self.passes, lists, depth)
            pipeline.attributes(self.passes, self.view, lists, depth, self.epsilon, gbuffer)
        return {name: self._read(name, value) for name, value in (vars(depth) | vars(gbuffer)).items()}

    def shade(self, sums):
        """Shade and resolve a G-buffer that the test wrote; `sums` has the names of the dataclasses' fields."""
        buffers = {name: self.passes.constant(array.astype(self.passes.real)) for name, array in sums.items()}
        depth = DepthBuffer(buffers.pop("depth"), None)
        gbuffer = GBuffer(**buffers, count=None)
        color = pipeline.shade(self.passes, self.view, depth, gbuffer)
        resolved = pipeline.resolve(self.passes, self.view, depth, gbuffer)
        return {"color": self._read("color", color, 4)} | {
            name: self._read(name, buffer) for name, buffer in resolved.items()
        }

    def _read(self, name, buffer, channels=None):
        vectors = ("color_sum", "normal_sum", "P", "N", "albedo")
        channels = channels or (3 if name in vectors else 1)
        dtype = np.dtype("u4") if name in ("particleid", "count") else self.passes.real
        size = (self.camera.height, self.camera.width)
        return self.device.read(buffer, size if channels == 1 else (*size, channels), dtype)
