"""``splatcl doctor``: whether a device computes exactly enough for reference renders."""

from __future__ import annotations

from splatcl.cli.options.device import DeviceOption
from splatcl.util.progress import stage


def doctor(*, device: DeviceOption = None, all: bool = False, json: bool = False) -> int:
    """Test a device's arithmetic against NumPy's, and render the golden images on it.

    Parameters
    ----------
    all : bool
        Test every device in turn.
    json : bool
        Print the list of reports as JSON.

    Returns
    -------
    int
        Exit status: 0 if every tested device is fit for reference renders, else 1.
    """
    from json import dumps

    from splatcl.evidence.doctor import examine
    from splatcl.opencl.device.devices import choose_device, list_devices

    reports = []
    for info in list_devices() if all else [choose_device(device)]:
        with stage(f"Examining {info.name}"):
            reports.append(examine(info))
        if not json:
            print("\n".join(reports[-1].lines()))
    if json:
        print(dumps([report.as_json() for report in reports], indent=1))
    return int(any(report.reasons for report in reports))
