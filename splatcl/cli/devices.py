"""``splatcl devices``: what OpenCL offers."""

from __future__ import annotations


def devices() -> None:
    """List the OpenCL devices; a star marks the one that is used (SPLATCL_DEVICE chooses another)."""
    from splatcl.device import choose_device, list_devices

    used = choose_device().index
    for device in list_devices():
        print(f"{'*' if device.index == used else ' '} {device.index}  {device.name}")
        print(f"     {device.platform}, {device.version}")
        print(f"     {', '.join(f'{name} {value}' for name, value in device.supports.items())}")
