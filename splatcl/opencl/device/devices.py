"""OpenCL devices: list them, and choose one."""

from __future__ import annotations

import os
import re
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from splatcl.errors import DeviceError

_opened_by: int | None = None
"""Id of the process that started OpenCL; None before the start."""


def forked() -> bool:
    """Return True if this process was forked after OpenCL had started, and so cannot use OpenCL (see worker.py)."""
    return _opened_by not in (None, os.getpid())


@dataclass(frozen=True)
class DeviceInfo:
    """One OpenCL device; `index` counts over all platforms, in the order of preference."""

    index: int
    platform: str
    name: str
    version: str
    is_default: bool
    supports: Mapping[str, str]
    handle: Any = field(repr=False, compare=False)


def cache_folder() -> Path:
    """Return the user's cache folder; `RuntimeError` if the user has no home folder."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")


def _ensure_cache_folder() -> None:
    """Give PoCL and PyOpenCL a cache folder that they can write; without one, neither starts."""
    try:
        folder = cache_folder()
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return
    except (OSError, RuntimeError):  # RuntimeError: the user has no home folder
        substitute = Path(tempfile.gettempdir()) / f"splatcl-cache-{os.getuid()}"
        substitute.mkdir(mode=0o700, exist_ok=True)
        if substitute.stat().st_uid != os.getuid():
            substitute = Path(tempfile.mkdtemp(prefix="splatcl-cache-"))
        os.environ["XDG_CACHE_HOME"] = str(substitute)


def _preference(device: Any) -> tuple[bool, bool, tuple[int, ...]]:
    """Return a sort key: PoCL's CPU first (the newest version first), then other CPUs, then other devices."""
    import pyopencl as cl

    is_pocl = "Portable Computing Language" in device.platform.name
    version = re.search(r"PoCL (\d+)\.(\d+)", device.platform.version)
    newest = tuple(-int(part) for part in version.groups()) if version else (0, 0)
    is_cpu = bool(device.type & cl.device_type.CPU)
    return (not (is_pocl and is_cpu), not is_cpu, newest)


def _supports(device: Any) -> dict[str, str]:
    return {
        "double": "yes" if "cl_khr_fp64" in device.extensions else "no",
        "compute units": str(device.max_compute_units),
        "float lanes": str(device.native_vector_width_float),
        "memory": f"{device.global_mem_size / 2**30:.1f} GiB",
        "largest buffer": f"{device.max_mem_alloc_size / 2**30:.1f} GiB",
    }


def list_devices() -> list[DeviceInfo]:
    """Return every OpenCL device, the default one first.

    Raises
    ------
    DeviceError
        OpenCL does not start.
    """
    global _opened_by
    _ensure_cache_folder()
    import pyopencl as cl

    _opened_by = os.getpid()
    try:
        handles = [device for platform in cl.get_platforms() for device in platform.get_devices()]
    except cl.Error as error:
        raise DeviceError(f"no OpenCL platform ({error}); pip install 'pyopencl[pocl]' installs one") from None
    handles.sort(key=_preference)
    return [
        DeviceInfo(i, d.platform.name, d.name.strip(), d.platform.version, i == 0, _supports(d), d)
        for i, d in enumerate(handles)
    ]


def choose_device(wanted: str | int | None = None) -> DeviceInfo:
    """Return the device that `wanted` names, else SPLATCL_DEVICE, else the default.

    Parameters
    ----------
    wanted : str or int, optional
        An index of `list_devices`, or words such as "pocl 3.1" or "intel". A device fits if its platform's name and
        version and its own name contain all words, in any case. A device with the words in sequence goes first.

    Raises
    ------
    DeviceError
        There is no device, or none fits.
    """
    devices = list_devices()
    if not devices:
        raise DeviceError("no OpenCL device; pip install 'pyopencl[pocl]' installs PoCL's CPU device")
    if wanted is None:
        wanted = os.environ.get("SPLATCL_DEVICE", "")
    wanted = str(wanted).strip()
    if not wanted:
        return devices[0]
    if wanted.isdigit() and int(wanted) < len(devices):
        return devices[int(wanted)]
    texts = [f"{d.platform} {d.version} {d.name}".lower() for d in devices]
    for words in ([wanted.lower()], wanted.lower().split()):
        for device, text in zip(devices, texts, strict=True):
            if not wanted.isdigit() and all(word in text for word in words):
                return device
    known = "; ".join(f"{d.index}: {d.version}, {d.name}" for d in devices)
    raise DeviceError(f"no OpenCL device fits {wanted!r}; choose one of {known}")
