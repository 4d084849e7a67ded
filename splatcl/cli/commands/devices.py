"""``splatcl devices``: the OpenCL devices of this machine."""

from __future__ import annotations

import sys

from splatcl.cli.options.device import DeviceOption
from splatcl.errors import DeviceError


def devices(*, device: DeviceOption = None) -> None:
    """List the OpenCL devices; a star marks the device in use."""
    from splatcl.opencl.device.devices import choose_device, list_devices

    known, used, refusal = list_devices(), None, None
    try:
        used = choose_device(device).index
    except DeviceError as error:
        refusal = error
    for info in known:
        print(f"{'*' if info.index == used else ' '} {info.index}  {info.name}")
        print(f"     {info.platform}, {info.version}")
        print(f"     {', '.join(f'{name} {value}' for name, value in info.supports.items())}")
    if refusal:
        sys.stdout.flush()
        raise refusal
