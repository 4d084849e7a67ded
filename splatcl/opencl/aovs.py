"""The AOVs of a drawn frame; each stays on the device until it is first read."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splatcl.errors import DeviceError
from splatcl.opencl.device.devices import forked
from splatcl.opencl.passes.shade import resolve
from splatcl.opencl.state.buffers import Raster
from splatcl.opencl.state.context import PassContext
from splatcl.scene.splats import PREFIX


class DeviceAovs(Mapping[str, NDArray[Any]]):
    """AOVs of one frame by name, read from the device at first use.

    The first use of an AOV that is a mean, such as N, also resolves the sums on the device.
    """

    def __init__(self, context: PassContext, raster: Raster, color: Any) -> None:
        self._context = context
        self._channels = {PREFIX + name: channel for name, channel in raster.channels.items()}
        self._resolve: Callable[[], dict[str, Any]] = lambda: resolve(context, raster)
        # Each AOV's buffer, number of channels, and dtype if it is not the frame's real.
        self._buffers: dict[str, tuple[Any, int, str]] = {
            "color": (color, 4, ""),
            "Z": (raster.depth.depth, 1, ""),
            "depth.mean": (None, 1, ""),
            "depth.distance": (None, 1, ""),
            "P": (None, 3, ""),
            "N": (None, 3, ""),
            "albedo": (None, 3, ""),
            "weight": (raster.gbuffer.weight_sum, 1, ""),
            "count": (raster.gbuffer.count, 1, "u4"),
            "particleid": (raster.depth.particleid, 1, "u4"),
            **{name: (image, 3, "") for name, (image, _) in self._channels.items()},
        }
        if context.settings.shading != "deferred":
            del self._buffers["albedo"]  # forward shading blends shaded colors
        self._arrays: dict[str, NDArray[Any]] = {}

    def __getitem__(self, name: str) -> NDArray[Any]:
        if name not in self._arrays and forked():
            raise DeviceError(f"cannot read the frame's {name} in a forked process: read it before the fork")
        if name not in self._arrays:
            with self._context.device.lock:
                self._arrays[name] = self._read(name)
        return self._arrays[name]

    def _read(self, name: str) -> NDArray[Any]:
        if self._buffers[name][0] is None:
            for resolved, buffer in self._resolve().items():
                if resolved not in self._buffers:
                    continue
                self._buffers[resolved] = (buffer, *self._buffers[resolved][1:])
        buffer, channels, dtype = self._buffers[name]
        camera = self._context.camera
        shape: tuple[int, ...] = (camera.height, camera.width) + ((channels,) if channels > 1 else ())
        array = self._context.device.read(buffer, shape, dtype or self._context.real)
        return np.ascontiguousarray(array[..., self._channels[name][1]]) if name in self._channels else array

    def __iter__(self) -> Iterator[str]:
        return iter(self._buffers)

    def __len__(self) -> int:
        return len(self._buffers)

    def __reduce__(self) -> tuple[type[dict[str, Any]], tuple[dict[str, NDArray[Any]]]]:
        """Pickle as plain arrays, which another process can read."""
        return dict, ({name: self[name] for name in self},)
