"""splatcl's own files keep every bit."""

import os
import stat
import time

import numpy as np
import pytest
from helpers.io_files import native

import splatcl


@pytest.mark.parametrize("name", ["a.ply", "a.npz"])
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("oriented", [True, False])
@pytest.mark.parametrize("num", [0, 50])
def test_native_round_trip_is_exact(tmp_path, name, dtype, oriented, num):
    splats = native(dtype, oriented, num)
    splatcl.write(splats, tmp_path / name)
    again = splatcl.read(tmp_path / name)
    for field in ("center", "tangent_u", "tangent_v", "color"):
        one, two = getattr(splats, field), getattr(again, field)
        assert one.dtype == two.dtype
        assert one.tobytes() == two.tobytes()
    for field in ("oriented", "num_dropped", "notes"):
        assert getattr(splats, field) == getattr(again, field)


@pytest.mark.parametrize("name", ["a.ply", "a.npz"])
def test_native_bytes_do_not_depend_on_when_or_where(tmp_path, name, monkeypatch):
    splatcl.write(native(), tmp_path / name)
    (tmp_path / "sub").mkdir()
    monkeypatch.setattr(time, "time", lambda: 1.5e9)
    splatcl.write(native(), tmp_path / "sub" / name)
    assert (tmp_path / name).read_bytes() == (tmp_path / "sub" / name).read_bytes()
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted([name, "sub"])  # no temporary file is left


def test_native_ply_is_plain_ply(tmp_path):
    splatcl.write(native(np.float32), tmp_path / "a.ply")
    head = (tmp_path / "a.ply").read_bytes().partition(b"end_header\n")[0].decode()
    assert "format binary_little_endian 1.0" in head
    assert [line.split()[2] for line in head.splitlines() if line.startswith("property float")] == [
        "x", "y", "z", "tu_x", "tu_y", "tu_z", "tv_x", "tv_y", "tv_z", "red", "green", "blue",
    ]  # fmt: skip


@pytest.mark.parametrize("name", ["a.ply", "a.npz"])
def test_native_files_follow_links_and_respect_the_umask(tmp_path, name):
    (tmp_path / "far").mkdir()
    (tmp_path / name).symlink_to(tmp_path / "far" / name)
    before = os.umask(0o027)
    try:
        splatcl.write(native(), tmp_path / name)
    finally:
        os.umask(before)
    assert (tmp_path / name).is_symlink()
    assert stat.S_IMODE((tmp_path / "far" / name).stat().st_mode) == 0o640
    assert len(splatcl.read(tmp_path / name)) == 50
