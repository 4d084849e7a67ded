"""The machine, the OpenCL device and the versions of a measurement."""

from __future__ import annotations

import os
import platform
from importlib.metadata import version
from pathlib import Path
from typing import Any

from splatcl.opencl.device.strictness import Device


def facts(device: Device) -> dict[str, Any]:
    """Return the machine, the OpenCL device and the versions as JSON's types."""
    info = device.info
    return {
        "machine": {
            "cpu": cpu_name(),
            "cpus": len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count(),
            "system": platform.platform(),
            "load_average": os.getloadavg()[0] if hasattr(os, "getloadavg") else None,
        },
        "device": {
            "name": info.name,
            "platform": info.platform,
            "version": info.version,
            "lanes": device.lanes,
            "mapping": device.mapping,
            **info.supports,
        },
        "versions": {"python": platform.python_version()}
        | {name: version(name) for name in ("splatcl", "numpy", "pyopencl")},
    }


def cpu_name() -> str:
    """Return the processor's name."""
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text().splitlines() if cpuinfo.exists() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()
