"""``splatcl doctor``: whether a device computes what references need."""

from __future__ import annotations

from splatcl.util.progress import stage


def doctor(*, device: str | None = None, all: bool = False, json: bool = False) -> int:
    """Test a device's arithmetic against NumPy's, and render the golden images on it (docs/trust/doctor.md).

    The exit status is 0 if the device is fit for reference renders, else 1.

    Parameters
    ----------
    device : str
        An index of `splatcl devices`, or words of its name and version [default: the one that renders].
    all : bool
        Every device, one after the other; the exit status is 0 if all are fit.
    json : bool
        Print a list of reports as JSON.
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
