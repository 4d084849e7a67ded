"""Measure the limits of the device: bandwidths of reading, writing and copying, and arithmetic."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from splatcl.apps.timing import seconds_of
from splatcl.opencl.device.strictness import Device
from splatcl.opencl.device.structs import REAL_CODES
from splatcl.scene.settings import Precision

BUFFER_BYTES = 512 << 20
"""Size of each buffer, far above the size of caches."""
SMALL_BYTES = 1 << 20
"""Size of each buffer if only the arithmetic is measured."""
STREAMS = 4
"""Number of independent sums in a work-item, so that the latency of + does not limit the reading."""
CHAINS = 16
"""Number of independent a = a b + c in a work-item: the number of vector registers; fewer or more are slower."""
REPETITIONS = 7
"""Number of measurements of a limit; the best one counts."""


@dataclass(frozen=True)
class Limits:
    """Bytes a second, and operations (+ and *) a second by precision."""

    read: float
    write: float
    copy: float
    flops: dict[Precision, float]


class Roofline:
    """The kernels of kernels/bench/roofline.cl on one device; `num_bytes` and `num_flops` are their work.

    Parameters
    ----------
    device : Device
    num_bytes : int
        Size of each of the two buffers.
    precision : {"single", "double"}
        Precision of the arithmetic.
    """

    def __init__(self, device: Device, num_bytes: int = BUFFER_BYTES, precision: Precision = "single") -> None:
        real = np.dtype(REAL_CODES[precision])
        self._device, self._real = device, real
        self._lanes = device.lanes_of(real)
        on_cpu = device.mapping == "tile"
        self._num_items, self._group = (64, 1) if on_cpu else (1 << 16, 64)
        self._steps = 1 << 17 if on_cpu else 1 << 13
        self.num_flops = self._num_items * self._steps * CHAINS * 2 * self._lanes
        unit = self._num_items * self._lanes * real.itemsize * STREAMS
        count = max(min(num_bytes, device.largest_buffer) // unit, 1) * STREAMS
        self.num_bytes = count // STREAMS * unit
        self._walk = (count, 1, count) if on_cpu else (1, self._num_items, count)
        self._numbers, self._copy = device.buffer(self.num_bytes), device.buffer(self.num_bytes)
        self._sums = device.buffer(self._num_items * self._lanes * real.itemsize)
        options = {"LANES": self._lanes, "DOUBLE": int(precision == "double"), "STREAMS": STREAMS, "CHAINS": CHAINS}
        self._program = device.program("bench/roofline.cl", "", **options, **device.strictness.options(precision))
        for touch in (self.write, self.copy, self.read):
            touch()

    def read(self) -> float:
        """Read one buffer; return the time, seconds."""
        return self._run("roofline_read", self._numbers, self._sums, *map(np.int32, self._walk))

    def write(self) -> float:
        """Write one buffer; return the time, seconds."""
        return self._run("roofline_write", self._numbers, *map(np.int32, self._walk))

    def copy(self) -> float:
        """Copy one buffer to the other; return the time, seconds."""
        return self._run("roofline_copy", self._numbers, self._copy, *map(np.int32, self._walk))

    def arithmetic(self) -> float:
        """Do `num_flops` operations; return the time, seconds."""
        numbers = self._real.type(0.999), self._real.type(0.001)
        return self._run("roofline_arithmetic", self._sums, *numbers, np.int32(self._steps))

    def _run(self, kernel: str, *args: Any) -> float:
        queue = self._device.queue
        queue.finish()

        def work() -> None:
            self._program(queue, kernel, (self._num_items,), self._group, *args)
            queue.finish()

        return seconds_of(work)


def measure_limits(device: Device, num_bytes: int = BUFFER_BYTES) -> Limits:
    """Measure each limit several times and return the best values."""
    single = Roofline(device, num_bytes)

    def best(measure: Callable[[], float]) -> float:
        return min(measure() for _ in range(REPETITIONS))

    flops: dict[Precision, float] = {"single": single.num_flops / best(single.arithmetic)}
    if device.info.supports["double"] == "yes":
        double = Roofline(device, SMALL_BYTES, "double")
        flops["double"] = double.num_flops / best(double.arithmetic)
    moved = single.num_bytes
    return Limits(
        read=moved / best(single.read),
        write=moved / best(single.write),
        copy=2 * moved / best(single.copy),
        flops=flops,
    )
