"""A quick test of a device's arithmetic before rendering; the user's cache folder keeps the result.

A device is strict if every operation of the kernels is correctly rounded. Another device is refused, or its images
are marked inexact.
"""

from __future__ import annotations

import hashlib
import json
import os
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from splatcl.errors import DeviceError, FileError
from splatcl.opencl.device import arithmetic, program
from splatcl.opencl.device.arithmetic import Arithmetic, Finding
from splatcl.opencl.device.devices import cache_folder
from splatcl.opencl.device.hard_cases import REALS
from splatcl.opencl.device.queue import DeviceQueue, WorkItem
from splatcl.scene.settings import Precision
from splatcl.util.atomic import atomic_path

FLAG_VARIABLES = ("PYOPENCL_BUILD_OPTIONS", "POCL_EXTRA_BUILD_FLAGS")
"""Environment variables that inject compiler flags; the flags could change the bits of an image."""


class Strictness:
    """The build options that make a device strict, and the reasons why its images may still be inexact.

    Parameters
    ----------
    device : DeviceQueue
    allow_inexact : bool
        Record the reasons against the device instead of refusing it.

    Raises
    ------
    DeviceError
        The environment injects compiler flags.
    """

    def __init__(self, device: DeviceQueue, allow_inexact: bool = False) -> None:
        self._device, self._allow_inexact = device, allow_inexact
        self._options: dict[Precision, dict[str, int]] = {}
        self._reasons: dict[str, str] = {}
        for variable, flags in injected_flags().items():
            self._distrust(variable, f"{variable} injects compiler flags, which can change an image: {flags}")

    def options(self, precision: Precision) -> dict[str, int]:
        """Return the build options that make every operation correctly rounded.

        Raises
        ------
        DeviceError
            No options do, and inexact devices are not allowed.
        """
        if precision not in self._options:
            found = quick_test(self._device, precision)
            if found.wrong:
                names = ", ".join(sorted({finding.operation for finding in found.wrong}))
                self._distrust(precision, f"{self._device.info.name} computes wrongly: {names} ({found.wrong[0]})")
            self._options[precision] = found.options
        return self._options[precision]

    def reason(self, precision: Precision) -> str:
        """Return why images of this precision may be inexact; "" if they are exact."""
        return "; ".join(reason for key, reason in self._reasons.items() if key in (*FLAG_VARIABLES, precision))

    def _distrust(self, key: str, reason: str) -> None:
        if not self._allow_inexact:
            raise DeviceError(f"{reason}; see `splatcl doctor`, or render with --allow-inexact")
        self._reasons[key] = reason


class Device(DeviceQueue):
    """A command queue on a device that is fit for reference renders.

    Parameters
    ----------
    device, lanes, mapping
        As for `DeviceQueue`.
    allow_inexact : bool
        Accept a device whose arithmetic is not strict, and injected compiler flags (`Strictness`).

    Raises
    ------
    DeviceError
        As `DeviceQueue` and `Strictness` do.
    """

    def __init__(
        self,
        device: str | int | None = None,
        lanes: int | None = None,
        mapping: WorkItem | None = None,
        allow_inexact: bool = False,
    ) -> None:
        super().__init__(device, lanes, mapping)
        self.strictness = Strictness(self, allow_inexact)


def injected_flags() -> dict[str, str]:
    """Return the variables of `FLAG_VARIABLES` that are set."""
    return {variable: os.environ[variable] for variable in FLAG_VARIABLES if os.environ.get(variable)}


def quick_test(device: DeviceQueue, precision: Precision) -> Arithmetic:
    """Test the vector widths that rendering uses, or return the result that the cache folder keeps."""
    lanes = tuple(sorted({1, device.lanes_of(np.dtype(REALS[precision]))}))
    path = _cache_folder() / f"arithmetic-{_key(device, precision, lanes)}.json"
    with suppress(OSError, ValueError, KeyError, TypeError):  # no result, or a damaged one
        return _from_json(json.loads(path.read_text()))
    found = arithmetic.examine(device, precision, lanes)
    with suppress(OSError, FileError):
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_path(path) as temporary:
            temporary.write_text(json.dumps(asdict(found)))
    return found


def _cache_folder() -> Path:
    return cache_folder() / "splatcl"


def _key(device: DeviceQueue, precision: Precision, lanes: tuple[int, ...]) -> str:
    """Return a hash of everything that affects the result: device, driver, injected flags, and the test's source."""
    handle = device.info.handle
    facts = (device.info.platform, device.info.version, device.info.name, handle.driver_version, precision, lanes)
    test = [Path(arithmetic.__file__).read_text(), program.inline_source("evidence/doctor.cl", {})]
    return hashlib.sha256(repr((facts, injected_flags(), test)).encode()).hexdigest()[:24]


def _from_json(fields: dict[str, Any]) -> Arithmetic:
    for name in ("wrong", "replaced", "subnormals"):
        fields[name] = tuple(Finding(**finding) for finding in fields[name])
    return Arithmetic(**(fields | {"lanes": tuple(fields["lanes"])}))
