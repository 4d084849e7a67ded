"""sRGB PNG files: curve, exposure, clamp, determinism, failures that leave no file."""

from __future__ import annotations

import errno
import os

import imageio.v3 as iio
import numpy as np
import pytest

from splatcl.errors import FileError, SettingsError
from splatcl.io import png
from splatcl.io.png import to_srgb8, write_png
from splatcl.util.atomic import atomic_path, check_writable


def pixel(rgb, alpha=1.0, exposure=0.0):
    color = np.array([[[*np.broadcast_to(rgb, 3), alpha]]], np.float32)
    return to_srgb8(color, exposure)[0, 0].tolist()


@pytest.mark.parametrize(
    ("linear", "level"),
    # Hand-computed from IEC 61966-2-1: 255 * (1.055 x^(1/2.4) - 0.055), or 255 * 12.92 x below 0.0031308.
    [
        (0.0, 0),
        (0.001, 3),
        (0.003, 10),
        (0.0031308, 10),
        (0.18, 118),
        (0.21586, 128),
        (0.5, 188),
        (1.0, 255),
    ],
)
def test_srgb_curve(linear, level):
    assert pixel(linear) == [level] * 3 + [255]


def test_every_level_survives_a_round_trip():
    encoded = np.arange(256) / 255
    linear = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    color = np.ones((1, 256, 4), np.float32)
    color[0, :, :3] = linear[:, None]
    np.testing.assert_array_equal(to_srgb8(color)[0, :, 0], np.arange(256))


def test_exposure_is_in_stops_and_leaves_alpha_alone():
    assert pixel(0.25, 0.5, exposure=1.0) == pixel(0.5, 0.5)
    assert pixel(0.5, 0.5, exposure=-2.0) == pixel(0.125, 0.5)
    assert pixel(0.25, 0.5, exposure=1.0)[3] == 128


@pytest.mark.parametrize("exposure", [np.nan, np.inf, -1e9])
def test_a_senseless_exposure_is_an_error(exposure):
    with pytest.raises(SettingsError, match="exposure"):
        pixel(0.5, exposure=exposure)


def test_clamps_and_survives_non_finite_values():
    assert pixel((-1.0, 2.0, np.inf), 7.0) == [0, 255, 255, 255]
    assert pixel((np.nan, -np.inf, 0.0), np.nan) == [0, 0, 0, 0]
    assert pixel(np.inf, exposure=100.0) == [255, 255, 255, 255]


def test_alpha_is_straight():
    assert pixel(1.0, 0.25) == [255, 255, 255, 64]


@pytest.mark.parametrize("height", [1, png.BAND - 1, png.BAND, png.BAND + 1])
def test_the_file_holds_the_pixels_in_place(tmp_path, height):
    color = np.random.default_rng(1).random((height, 3, 4), dtype=np.float32)
    write_png(tmp_path / "a.png", color)
    np.testing.assert_array_equal(iio.imread(tmp_path / "a.png"), to_srgb8(color))


@pytest.mark.parametrize("view", [np.flipud, np.asfortranarray, lambda c: c[::2, ::-1]])
def test_strided_arrays_are_written_right(tmp_path, view):
    color = view(np.random.default_rng(2).random((6, 4, 4), dtype=np.float32))
    write_png(tmp_path / "a.png", color)
    np.testing.assert_array_equal(iio.imread(tmp_path / "a.png"), to_srgb8(np.ascontiguousarray(color)))


def test_two_writes_are_identical(tmp_path):
    color = np.random.default_rng(3).random((5, 7, 4), dtype=np.float32)
    write_png(tmp_path / "a.png", color)
    write_png(tmp_path / "b.png", color)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


BLACK = np.zeros((1, 1, 4), np.float32)


@pytest.mark.parametrize("writes", [lambda p: write_png(p, BLACK), check_writable])
def test_unusable_targets_are_one_clear_line(tmp_path, writes):
    (tmp_path / "folder.png").mkdir()
    (tmp_path / "file").write_text("x")
    for name, reason in [
        ("folder.png", "it is a folder"),
        ("missing/a.png", "does not exist"),
        ("file/a.png", "cannot write"),
        ("x" * 300 + ".png", "File name too long"),
        ("a\0.png", "null"),
        ("/dev/null", "not a regular file"),
    ]:
        with pytest.raises(FileError, match=reason) as caught:
            writes(tmp_path / name)
        assert "\n" not in str(caught.value)
    assert sorted(p.name for p in tmp_path.rglob("*")) == ["file", "folder.png"]


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_read_only_folder_or_file_is_refused(tmp_path):
    (tmp_path / "a.png").write_bytes(b"keep")
    (tmp_path / "a.png").chmod(0o444)
    with pytest.raises(FileError, match="read-only"):
        write_png(tmp_path / "a.png", BLACK)
    tmp_path.chmod(0o555)
    with pytest.raises(FileError, match="Permission denied"):
        check_writable(tmp_path / "b.png")
    tmp_path.chmod(0o755)


def test_a_failure_keeps_the_old_file_and_leaves_no_other(tmp_path):
    (tmp_path / "a.png").write_bytes(b"old")
    with pytest.raises(KeyboardInterrupt), atomic_path(tmp_path / "a.png") as temporary:
        temporary.write_bytes(b"half")
        raise KeyboardInterrupt
    with (
        pytest.raises(FileError, match=r"a\.png: cannot write: No space left"),
        atomic_path(tmp_path / "a.png"),
    ):
        raise OSError(errno.ENOSPC, "No space left on device")
    assert [p.name for p in tmp_path.iterdir()] == ["a.png"]
    assert (tmp_path / "a.png").read_bytes() == b"old"


def test_the_temporary_file_is_beside_the_target_with_its_extension(tmp_path):
    with atomic_path(tmp_path / "a.exr") as temporary:
        assert temporary.parent == tmp_path and temporary.suffix == ".exr"
        temporary.write_bytes(b"new")
    assert (tmp_path / "a.exr").read_bytes() == b"new"


def test_files_get_the_permissions_of_any_new_file(tmp_path):
    write_png(tmp_path / "a.png", BLACK)
    (tmp_path / "plain").write_text("")
    assert (tmp_path / "a.png").stat().st_mode == (tmp_path / "plain").stat().st_mode


def test_a_symbolic_link_is_followed(tmp_path):
    (tmp_path / "data").mkdir()
    (tmp_path / "link.png").symlink_to(tmp_path / "data" / "real.png")
    write_png(tmp_path / "link.png", BLACK)
    assert (tmp_path / "link.png").is_symlink() and (tmp_path / "data" / "real.png").is_file()


def test_check_writable_changes_nothing(tmp_path):
    (tmp_path / "a.png").write_bytes(b"old")
    check_writable(tmp_path / "a.png")
    check_writable(tmp_path / "b.png")
    assert [p.name for p in tmp_path.iterdir()] == ["a.png"] and (tmp_path / "a.png").read_bytes() == b"old"
