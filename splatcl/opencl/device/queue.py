"""A command queue on one device, with its built programs and its buffers."""

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
"""Work of one work-item of the raster passes."""

HUGE_PAGES_FROM = 16 << 20
"""Least size of a CPU's buffer with huge pages, bytes. They make random access to the splats a third cheaper."""
MADV_HUGEPAGE = 14
"""Linux's constant for madvise."""


def _advise_huge_pages(queue: Any, buffer: Any, num_bytes: int) -> None:
    """Ask Linux for huge pages under a CPU's buffer; if it refuses, nothing changes."""
    import ctypes

    import pyopencl as cl

    mapped, _ = cl.enqueue_map_buffer(queue, buffer, cl.map_flags.WRITE, 0, (num_bytes,), np.dtype(np.uint8))
    start = -(-mapped.ctypes.data // mmap.PAGESIZE) * mmap.PAGESIZE
    length = mapped.ctypes.data + num_bytes - start
    with suppress(OSError, AttributeError):
        ctypes.CDLL(None).madvise(ctypes.c_void_p(start), ctypes.c_size_t(length), MADV_HUGEPAGE)
    mapped.base.release(queue)


class DeviceQueue:
    """A command queue on one device, with its built programs and its reusable scratch buffers.

    Parameters
    ----------
    device : str, int, optional
        As for `choose_device`.
    lanes : int, optional
        Pixels or splats per vector; by default 8 on a CPU (1 on rusticl), and 1 elsewhere.
    mapping : {"tile", "pixel"}, optional
        Work of one work-item of the raster passes; by default a tile on a CPU, and a pixel elsewhere.
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
        # rusticl vectorizes over work-items; explicit vectors make it slower, and compiling takes minutes.
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
        self._pixels = 0  # per image in the pool
        self.largest_buffer = handle.max_mem_alloc_size
        self.lock = threading.RLock()
        self._programs: dict[tuple[Any, ...], Program] = {}
        self._scratch: dict[str, Any] = {}

    def lanes_of(self, real: np.dtype[Any]) -> int:
        """Return the number of `real` in one vector: 32 bytes at most, or 64 bytes for 16 lanes."""
        return min(self.lanes, max(4 * self.lanes, 32) // real.itemsize)

    def program(self, name: str, prelude: str, **options: str | int) -> Program:
        """Return kernels/`name` built with `options`; the queue keeps every program that it has built."""
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
        """Return an image buffer from a pool; releasing it returns it there, so its pages are not cleared again.

        The pool holds images of one size, so that it does not grow with each new size.
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
        """Return the scratch buffer `name` of at least `num_bytes`, with undefined content."""
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
        """Return a new buffer with a copy of a contiguous `array`."""
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
