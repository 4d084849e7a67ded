"""Errors of the command line: exit status and words; and `splatcl devices`."""

from __future__ import annotations

import errno
import resource
from contextlib import contextmanager

import pytest
from helpers.cli_stub import run, stub

from splatcl.cli import FAILED, MISTAKE, as_options
from splatcl.errors import DeviceError, FileError
from splatcl.opencl.device import devices, program

__all__ = ["stub"]  # a fixture


@pytest.mark.parametrize(
    ("text", "options"),
    [
        (
            "s.ply: 1 of 2 points; drop them with on_invalid='drop'",
            "s.ply: 1 of 2 points; drop them with --on-invalid drop",
        ),
        ("facing='cull' needs oriented normals", "--facing cull needs oriented normals"),
        ("tile_size 17 is not one of (8, 16)", "--tile-size 17 is not one of (8, 16)"),
        ("fov_y 180 must be between", "--fov 180 must be between"),
        ("prefilter_radius 0.0 must be between", "--prefilter-radius 0.0 must be between"),
        ("kernel='table' and kernel_table need each other", "--kernel table and --kernel-table need each other"),
        ("material.ambient -1.0 must be", "--material.ambient -1.0 must be"),
        ("image size 99999x5 is outside", "--size 99999x5 is outside"),
        ("render with --allow-inexact", "render with --allow-inexact"),
        ("use allow_inexact=True", "use --allow-inexact"),
        ("up array([0, 0]) is not a direction", "--up array([0, 0]) is not a direction"),
        (
            "/data/on_invalid/fov_y.ply: line 3 names 'tile_size'",
            "/data/on_invalid/fov_y.ply: line 3 names 'tile_size'",
        ),
        ("a.ply: the kernel of a facing up", "a.ply: the kernel of a facing up"),
        ("upper.ply: is empty", "upper.ply: is empty"),
    ],
)
def test_errors_speak_of_options(text, options):
    assert as_options(text) == options


def caused(error, cause):
    error.__cause__ = error.__context__ = cause
    return error


@pytest.mark.parametrize(
    ("error", "status"),
    [
        (caused(FileError("o.exr: cannot write: No space left on device"), OSError(errno.ENOSPC, "")), FAILED),
        (caused(FileError("s.ply: Input/output error"), OSError(errno.EIO, "")), FAILED),
        (caused(FileError("s.ply: there is not enough memory to read it"), MemoryError()), FAILED),
        (caused(DeviceError("kernels/passes/bin.cl does not build"), RuntimeError()), FAILED),
        (caused(FileError("s.ply: No such file"), FileNotFoundError(errno.ENOENT, "")), MISTAKE),
        (caused(FileError("s.ply: Permission denied"), PermissionError(errno.EACCES, "")), MISTAKE),
        (caused(FileError("s.ply: not a readable PLY file"), ValueError()), MISTAKE),
        (DeviceError("no OpenCL device fits 'x'"), MISTAKE),
    ],
)
def test_a_failed_run_is_1_and_a_mistake_is_2(stub, capsys, monkeypatch, error, status):
    def fail(*args):
        raise error

    monkeypatch.setattr("splatcl.io.read.read", fail)
    assert run(capsys, "render s.ply -o o.exr") == (status, [], [f"splatcl: error: {error}"])


@pytest.mark.parametrize(("number", "status"), [(errno.EIO, FAILED), (errno.EINVAL, MISTAKE), (None, MISTAKE)])
def test_a_library_that_meets_a_failing_disk(capsys, monkeypatch, tmp_path, number, status):
    def fail(*args, **kwargs):
        raise OSError(number, "Input/output error")

    (tmp_path / "s.ply").write_text("ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n1\n")
    monkeypatch.setattr("plyfile.PlyData.read", fail)
    got, _, err = run(capsys, f"info {tmp_path}/s.ply")
    assert got == status and len(err) == 1 and err[0].startswith(f"splatcl: error: {tmp_path}/s.ply: ")


@contextmanager
def full_disk():
    """Limit files to 100 bytes, within the context alone: the log of the tests is a file too."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.parametrize("name", ["o.png", "o.exr"])
def test_a_full_disk_is_a_failed_run(stub, capsys, tmp_path, name):
    with full_disk():
        status, _, err = run(capsys, f"render s.ply -o {name}")
    assert status == FAILED and len(err) == 1 and err[0].startswith(f"splatcl: error: {name}: cannot write: ")
    assert list(tmp_path.iterdir()) == []


def test_a_kernel_that_does_not_build_is_a_failed_run(capsys, monkeypatch, tmp_path):
    (tmp_path / "s.xyz").write_text("0 0 0\n1 0 0\n0 1 0\n")
    monkeypatch.setattr(program, "inline_source", lambda *args: "not OpenCL")
    status, _, err = run(capsys, f"render {tmp_path}/s.xyz --png {tmp_path}/o.png --allow-inexact")
    assert status == FAILED and "does not build on this device" in err[0]


KNOWN = [
    devices.DeviceInfo(0, "Platform A", "cpu", "OpenCL 3.0 A", True, {"double": "yes"}, None),
    devices.DeviceInfo(1, "Platform B", "gpu", "OpenCL 1.2 B", False, {"double": "no", "lanes": "1"}, None),
]
LIST = [
    "{} 0  cpu",
    "     Platform A, OpenCL 3.0 A",
    "     double yes",
    "{} 1  gpu",
    "     Platform B, OpenCL 1.2 B",
    "     double no, lanes 1",
]


@pytest.mark.parametrize(
    ("variable", "option", "marks"),
    [("", "", "* "), ("platform b", "", " *"), ("platform b", "--device 0", "* "), ("", "--device gpu", " *")],
)
def test_devices_lists_them_and_stars_the_one_in_use(capsys, monkeypatch, variable, option, marks):
    monkeypatch.setattr(devices, "list_devices", lambda: KNOWN)
    monkeypatch.setenv("SPLATCL_DEVICE", variable)
    marked = [line.format(marks[i // 3]) for i, line in enumerate(LIST)]
    assert run(capsys, f"devices {option}") == (0, marked, [])


@pytest.mark.parametrize(("variable", "option"), [("foo", ""), ("", "--device foo")])
def test_a_bad_choice_of_device_still_lists_them_all(capsys, monkeypatch, variable, option):
    monkeypatch.setattr(devices, "list_devices", lambda: KNOWN)
    monkeypatch.setenv("SPLATCL_DEVICE", variable)
    status, out, err = run(capsys, f"devices {option}")
    assert (status, out) == (MISTAKE, [line.format(" ") for line in LIST])
    assert len(err) == 1 and err[0].startswith("splatcl: error: no OpenCL device fits 'foo'")
