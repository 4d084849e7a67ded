"""A command queue on one device, with its programs and buffers."""

from __future__ import annotations

import mmap
import threading
from contextlib import suppress
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from splatcl.errors import DeviceError
from splatcl.opencl.device.devices import choose_device
from splatcl.opencl.device.program import Program

WorkItem = Literal["tile", "pixel"]

HUGE_PAGES_FROM = 16 << 20
"""Bytes of a CPU's buffer from which it asks for huge pages: splats fetched in another order then cost a third less."""
MADV_HUGEPAGE = 14


def _advise_huge_pages(queue: Any, buffer: Any, num_bytes: int) -> None:
    """Ask Linux for huge pages where a CPU's buffer lies; it may refuse, and nothing else changes."""
    import ctypes

    import pyopencl as cl

    place, _ = cl.enqueue_map_buffer(queue, buffer, cl.map_flags.WRITE, 0, (num_bytes,), np.dtype(np.uint8))
    start = -(-place.ctypes.data // mmap.PAGESIZE) * mmap.PAGESIZE
    length = place.ctypes.data + num_bytes - start
    with suppress(OSError, AttributeError):
        ctypes.CDLL(None).madvise(ctypes.c_void_p(start), ctypes.c_size_t(length), MADV_HUGEPAGE)
    place.base.release(queue)


class DeviceQueue:
    """A command queue on one device, with its built programs and its reusable scratch buffers.

    Parameters
    ----------
    device : str, int, optional
        As for `choose_device`.
    lanes : int, optional
        Pixels or splats per vector: 8 on a CPU (1 on rusticl), 1 elsewhere by default.
    mapping : {"tile", "pixel"}, optional
        What a work-item of the raster passes takes: a tile on a CPU, a pixel elsewhere by default.
    """

    def __init__(
        self,
        device: str | int | None = None,
        lanes: int | None = None,
        mapping: WorkItem | None = None,
    ) -> None:
        self.info = choose_device(device)
        import pyopencl as cl
        import pyopencl.tools

        handle = self.info.handle
        self._is_cpu = is_cpu = bool(handle.type & cl.device_type.CPU)
        self.mapping = mapping or ("tile" if is_cpu else "pixel")
        # rusticl makes vectors of work-items by itself: with ours it is slower, and compiles for minutes.
        own_vectors = is_cpu and "rusticl" not in self.info.platform.lower()
        self.lanes = lanes or (8 if own_vectors and self.mapping == "tile" else 1)
        if self.lanes > 8 and "PoCL 3.0" in self.info.version:
            raise DeviceError(
                f"{self.info.version} cannot compile {self.lanes}-wide square roots and would abort this process; "
                "use lanes=8 or another device"
            )
        try:
            self.context = cl.Context([handle])
            self.queue = cl.CommandQueue(self.context)
        except cl.Error as error:
            raise DeviceError(f"{self.info.version}, {self.info.name} does not start: {error}") from None
        self._images = cl.tools.MemoryPool(cl.tools.ImmediateAllocator(self.queue))
        self._pixels = 0  # of the images in the pool
        self.largest_buffer = handle.max_mem_alloc_size
        self.lock = threading.RLock()
        self._programs: dict[tuple[Any, ...], Program] = {}
        self._scratch: dict[str, Any] = {}

    def lanes_of(self, real: np.dtype[Any]) -> int:
        """Return how many `real` one vector holds: 32 bytes at most, or the 64 bytes of 16 lanes."""
        return min(self.lanes, max(4 * self.lanes, 32) // real.itemsize)

    def program(self, name: str, prelude: str, **options: str | int) -> Program:
        """Return kernels/`name` built with `options`, from this queue's own store if it has been built."""
        options["ON_POCL"] = int("Portable Computing Language" in self.info.platform)
        key = (name, prelude, *sorted(options.items()))
        if key not in self._programs:
            self._programs[key] = Program(self.context, name, prelude, options)
        return self._programs[key]

    def buffer(self, num_bytes: int) -> Any:
        """Return a new buffer of at least one byte that the host can map."""
        import pyopencl as cl

        self._check_size(num_bytes)
        flags = cl.mem_flags.READ_WRITE | cl.mem_flags.ALLOC_HOST_PTR
        buffer = cl.Buffer(self.context, flags, size=max(num_bytes, 1))
        if num_bytes >= HUGE_PAGES_FROM and self._is_cpu:
            _advise_huge_pages(self.queue, buffer, num_bytes)
        return buffer

    def image(self, num_pixels: int, pixel_bytes: int) -> Any:
        """Return a buffer from a pool, to which it goes back when it is no longer used: clearing pages costs 3 ms.

        The pool is for images of one size, or it would grow with each new one.
        """
        import pyopencl as cl

        num_bytes = num_pixels * pixel_bytes
        self._check_size(num_bytes)
        if num_pixels != self._pixels:
            self._images.stop_holding()
            self._images = cl.tools.MemoryPool(cl.tools.ImmediateAllocator(self.queue))
            self._pixels = num_pixels
        pool = self._images
        rounds_too_far = pool.alloc_size(pool.bin_number(num_bytes)) > self.largest_buffer
        return self.buffer(num_bytes) if rounds_too_far else pool.allocate(num_bytes)

    def scratch(self, name: str, num_bytes: int) -> Any:
        """Return the buffer kept under `name`, grown to at least `num_bytes`; its content is undefined."""
        held = self._scratch.get(name)
        if held is None or held.size < num_bytes:
            self._scratch.pop(name, None)
            del held
            self._scratch[name] = self.buffer(num_bytes)
        return self._scratch[name]

    def _check_size(self, num_bytes: int) -> None:
        if num_bytes > self.largest_buffer:
            raise DeviceError(
                f"a buffer of {num_bytes / 2**20:.0f} MiB exceeds this device's {self.largest_buffer / 2**20:.0f} MiB; "
                "use a smaller image or fewer splats"
            )

    def upload(self, array: NDArray[Any]) -> Any:
        """Return a new buffer that holds a contiguous `array`."""
        buffer = self.buffer(array.nbytes)
        self.write(buffer, array)
        return buffer

    def write(self, buffer: Any, array: NDArray[Any]) -> None:
        """Copy a contiguous `array` to the start of `buffer`."""
        import pyopencl as cl

        cl.enqueue_copy(self.queue, buffer, array)

    def read(self, buffer: Any, shape: tuple[int, ...], dtype: Any) -> NDArray[Any]:
        """Return a copy of the start of `buffer` as an array."""
        import pyopencl as cl

        array = np.empty(shape, dtype)
        if array.size:
            cl.enqueue_copy(self.queue, array, buffer)
        return array
