"""OpenEXR files: channels, camera attributes, the JSON string, determinism, damage."""

from __future__ import annotations

import json
import multiprocessing
import subprocess
import sys

import numpy as np
import OpenEXR
import pytest

from splatcl import Camera, RenderSettings, SplatclError
from splatcl.errors import FileError
from splatcl.frame import Frame
from splatcl.io.exr import read_exr, world_to_camera, world_to_ndc

UINT_CHANNELS = ["count", "particleid"]
FLOAT_CHANNELS = [
    *("R", "G", "B", "A", "Z", "depth.mean", "depth.distance", "weight"),
    *("P.X", "P.Y", "P.Z", "N.X", "N.Y", "N.Z", "albedo.R", "albedo.G", "albedo.B"),
]


def make_aovs(height=5, width=7):
    rng = np.random.default_rng(7)
    shapes = {"color": (4,), "P": (3,), "N": (3,), "albedo": (3,)}
    names = ("color", "Z", "depth.mean", "depth.distance", "P", "N", "albedo", "weight")
    aovs = {n: rng.standard_normal((height, width, *shapes.get(n, ()))).astype(np.float32) for n in names}
    aovs["Z"][0, :3] = np.inf, -np.inf, np.nan
    aovs["P"][1, 1] = np.nan, 1e-42, -0.0
    aovs["count"] = rng.integers(0, 9, (height, width), dtype=np.uint32)
    aovs["particleid"] = rng.integers(0, 2**32, (height, width), dtype=np.uint32)
    aovs["particleid"][0, 0] = 0xFFFFFFFF
    return aovs


def make_frame(aovs=None, camera=None, **metadata):
    aovs = make_aovs() if aovs is None else aovs
    height, width = next(iter(aovs.values())).shape[:2]
    camera = camera or Camera.look_at((1, 2, 3), (0, 0.1, 0), fov_y=33.3, width=width, height=height)
    return Frame(aovs, camera, RenderSettings(epsilon=0.125), metadata)


def opened(path):
    image = OpenEXR.File(str(path), separate_channels=True)
    return image.header(), {name: channel.pixels for name, channel in image.channels().items()}


def test_channels_have_the_specified_names_types_and_values(tmp_path):
    frame = make_frame()
    frame.save(tmp_path / "a.exr")
    header, planes = opened(tmp_path / "a.exr")
    assert sorted(planes) == sorted(FLOAT_CHANNELS + UINT_CHANNELS)
    assert header["compression"] == OpenEXR.ZIP_COMPRESSION
    assert {planes[name].dtype for name in FLOAT_CHANNELS} == {np.dtype(np.float32)}
    assert {planes[name].dtype for name in UINT_CHANNELS} == {np.dtype(np.uint32)}
    for i, name in enumerate("RGBA"):
        np.testing.assert_array_equal(planes[name], frame.color[..., i])
    for i, axis in enumerate("XYZ"):
        np.testing.assert_array_equal(planes[f"P.{axis}"].view(np.uint32), frame["P"][..., i].view(np.uint32))
        np.testing.assert_array_equal(planes[f"N.{axis}"], frame["N"][..., i])
        np.testing.assert_array_equal(planes[f"albedo.{'RGB'[i]}"], frame["albedo"][..., i])
    for name in ("Z", "depth.mean", "depth.distance", "weight", "count", "particleid"):
        np.testing.assert_array_equal(planes[name].view(np.uint32), frame[name].view(np.uint32))


def test_reading_back_gives_the_same_bits_camera_and_metadata(tmp_path):
    camera = Camera.look_at((1e6 + 0.123, 2, 3), (1e6, 0, 0), width=7, height=5, near=0.1)
    frame = make_frame(camera=camera, epsilon=np.float32(0.1), device="PoCL", num_splats=np.int64(3), far=np.inf)
    frame.save(tmp_path / "a.exr")
    aovs, back, metadata = read_exr(tmp_path / "a.exr")
    assert sorted(aovs) == sorted(frame)
    for name in frame:
        assert aovs[name].dtype == frame[name].dtype and aovs[name].shape == frame[name].shape
        assert aovs[name].tobytes() == frame[name].tobytes(), name
    assert back is not None
    np.testing.assert_array_equal(back.eye_from_world, camera.eye_from_world)
    for name in ("fx", "fy", "cx", "cy", "width", "height", "near", "far", "projection"):
        assert getattr(back, name) == getattr(camera, name)
    assert metadata["epsilon"] == float(np.float32(0.1))
    assert (metadata["device"], metadata["num_splats"], metadata["far"]) == ("PoCL", 3, "inf")
    assert metadata["settings"]["epsilon"] == 0.125 and metadata["settings"]["prefilter"] == "min"
    assert metadata["settings"]["lights"][0]["kind"] == "headlight"
    assert {"splatcl", "numpy", "OpenEXR"} <= set(metadata["versions"])


@pytest.mark.parametrize(
    "view",
    [
        lambda a: a[::-1],
        lambda a: a[:, ::-1],
        lambda a: np.asfortranarray(a),
        lambda a: np.repeat(a, 2, axis=1)[:, ::2],
        lambda a: a.astype(">f4") if a.dtype.kind == "f" else a.astype(">u4"),
    ],
)
def test_strided_flipped_fortran_and_big_endian_arrays_are_written_right(tmp_path, view):
    aovs = {name: view(array) for name, array in make_aovs().items()}
    make_frame(aovs).save(tmp_path / "a.exr")
    back, _, _ = read_exr(tmp_path / "a.exr")
    for name, array in aovs.items():
        np.testing.assert_array_equal(back[name], array)


def test_writing_changes_neither_arrays_nor_metadata(tmp_path):
    aovs = make_aovs()
    before = {name: array.copy() for name, array in aovs.items()}
    frame = make_frame(aovs, epsilon=0.5)
    frame.save(tmp_path / "a.exr")
    assert list(aovs) == list(before) and frame.metadata == {"epsilon": 0.5}
    for name in aovs:
        assert type(aovs[name]) is np.ndarray and aovs[name].tobytes() == before[name].tobytes()


WRITE = """
import pickle, sys
pickle.load(open(sys.argv[1], "rb")).save(sys.argv[2])
"""


def test_bytes_are_the_same_in_every_process(tmp_path):
    import pickle

    aovs = {name: np.tile(a, (40, 40) + (1,) * (a.ndim - 2)) for name, a in make_aovs().items()}
    frame = make_frame(aovs, epsilon=0.5, device="x")
    (tmp_path / "frame").write_bytes(pickle.dumps(frame))
    names = ["a.exr", "b.exr", "c.exr"]
    frame.save(tmp_path / names[0])
    for name, seed in zip(names[1:], "12", strict=True):
        command = [sys.executable, "-c", WRITE, tmp_path / "frame", tmp_path / name]
        subprocess.run(command, check=True, env={"PYTHONHASHSEED": seed})
    assert len({(tmp_path / name).read_bytes() for name in names}) == 1


def row_vector(point, matrix):
    return np.append(point, 1.0) @ matrix.astype(np.float64)


def test_world_to_camera_is_x_right_y_up_z_forward():
    # At (1, 2, 13), looking along -z of the world, y up: right is +x, up is +y, forward is -z.
    camera = Camera.look_at((1, 2, 13), (1, 2, 0), width=64, height=48)
    matrix = world_to_camera(camera)
    np.testing.assert_allclose(row_vector((4, 7, 3), matrix), (3, 5, 10, 1))
    np.testing.assert_allclose(row_vector((1, 2, 13), matrix), (0, 0, 0, 1), atol=1e-6)
    assert np.linalg.det(matrix[:3, :3]) == pytest.approx(-1)  # the world's axes are right-handed


def test_world_to_ndc_is_a_hand_computed_perspective():
    # x = fx X/Z + cx = 50 * 3/10 + 20 = 35 of 80 px; y = fy Y/Z + cy = 100 * -5/10 + 60 = 10 of 40 px
    matrix = Camera.look_at((1, 2, 13), (1, 2, 0)).eye_from_world
    camera = Camera(matrix, fx=50, fy=100, cx=20, cy=60, width=80, height=40)
    x, y, z, w = row_vector((4, 7, 3), world_to_ndc(camera))
    assert (x / w, y / w) == pytest.approx((35 / 80, 10 / 40))
    assert z / w == pytest.approx(1 / 10)


def test_world_to_ndc_is_a_hand_computed_orthographic():
    matrix = Camera.look_at((1, 2, 13), (1, 2, 0)).eye_from_world
    camera = Camera(matrix, 5, 10, 20, 60, width=80, height=40, projection="orthographic")
    x, y, z, w = row_vector((4, 7, 3), world_to_ndc(camera))
    assert (x, y, z, w) == pytest.approx(((5 * 3 + 20) / 80, (10 * -5 + 60) / 40, 10, 1))


def test_the_corners_of_the_image_are_the_corners_of_ndc():
    # fx = width, cx = 0: the ray through the lower right corner is d = (1, 1, 1).
    camera = Camera(np.eye(4), fx=8, fy=6, cx=0, cy=0, width=8, height=6)
    for point, corner in [((0, 0, 2), (0, 0)), ((2, 2, 2), (1, 1))]:
        x, y, _, w = row_vector(point, world_to_ndc(camera))
        assert (x / w, y / w) == corner


def test_attributes_in_the_file_are_row_vector_matrices(tmp_path):
    camera = Camera.look_at((1, 2, 13), (1, 2, 0), width=7, height=5)
    make_frame(camera=camera).save(tmp_path / "a.exr")
    data = (tmp_path / "a.exr").read_bytes()
    start = data.index(b"worldToCamera\0m44f\0") + len(b"worldToCamera\0m44f\0") + 4
    stored = np.frombuffer(data, "<f4", 16, start)  # m44f: x[0][0], x[0][1] ...; translation at 12, 13, 14
    np.testing.assert_allclose(stored[12:], (-1, -2, 13, 1))
    header, _ = opened(tmp_path / "a.exr")
    np.testing.assert_array_equal(header["worldToCamera"], world_to_camera(camera))
    np.testing.assert_array_equal(header["worldToNDC"], world_to_ndc(camera))
    assert json.loads(header["splatcl"])["camera"]["axes"] == "opencv"


def test_a_1x1_and_an_odd_sized_frame(tmp_path):
    for height, width in [(1, 1), (17, 1), (1, 33)]:
        aovs = {"color": np.ones((height, width, 4), np.float32), "margin": np.ones((height, width))}
        make_frame(aovs).save(tmp_path / "a.exr")
        back, _, _ = read_exr(tmp_path / "a.exr")
        assert back["color"].shape == (height, width, 4) and back["margin"].dtype == np.float32


def test_a_wrong_shape_is_an_error_and_leaves_nothing(tmp_path):
    aovs = make_aovs() | {"N": np.zeros((5, 7, 2), np.float32)}
    with pytest.raises(SplatclError, match="AOV N has shape"):
        make_frame(aovs).save(tmp_path / "a.exr")
    assert list(tmp_path.iterdir()) == []


def test_a_failing_write_keeps_the_old_file(tmp_path, monkeypatch):
    class Failing(OpenEXR.File):
        def write(self, file):
            file.write(b"half")
            raise RuntimeError("Failed to write pixel data")

    (tmp_path / "a.exr").write_bytes(b"old")
    monkeypatch.setattr(OpenEXR, "File", Failing)
    with pytest.raises(FileError, match=r"a\.exr: cannot write: Failed to write"):
        make_frame().save(tmp_path / "a.exr")
    assert [p.name for p in tmp_path.iterdir()] == ["a.exr"] and (tmp_path / "a.exr").read_bytes() == b"old"


@pytest.mark.parametrize("size", [1, 200])
def test_a_full_disk_is_noticed_at_every_size(tmp_path, monkeypatch, size):
    import contextlib
    from pathlib import Path

    @contextlib.contextmanager
    def full_disk(path):
        yield Path("/dev/full")

    monkeypatch.setattr("splatcl.io.exr.atomic_path", full_disk)
    noise = np.random.default_rng(0).random((size, size, 4), dtype=np.float32)
    with pytest.raises(OSError, match="No space left"):
        make_frame({"color": noise}).save(tmp_path / "a.exr")


def test_foreign_files_are_read_without_camera(tmp_path):
    OpenEXR.File({}, {"Y": np.ones((2, 3), np.float32), "N.X": np.ones((2, 3), np.float32)}).write(
        str(tmp_path / "a.exr")
    )
    aovs, camera, metadata = read_exr(tmp_path / "a.exr")
    assert sorted(aovs) == ["N.X", "Y"] and camera is None and metadata == {}


def test_bad_files_are_errors_that_name_the_file(tmp_path):
    make_frame().save(tmp_path / "good.exr")
    data = (tmp_path / "good.exr").read_bytes()
    cases = {"empty": b"", "text": b"hello world", "short": data[:60], "cut": data[: len(data) * 2 // 3]}
    for name, content in cases.items():
        (tmp_path / name).write_bytes(content)
        with pytest.raises(FileError, match=name):
            read_exr(tmp_path / name)
    with pytest.raises(FileError, match="No such file"):
        read_exr(tmp_path / "missing.exr")
    with pytest.raises(FileError, match="directory"):
        read_exr(tmp_path)


def test_the_order_of_metadata_does_not_change_the_bytes(tmp_path):
    make_frame(epsilon=1.0, device="x").save(tmp_path / "a.exr")
    make_frame(device="x", epsilon=1.0).save(tmp_path / "b.exr")
    assert (tmp_path / "a.exr").read_bytes() == (tmp_path / "b.exr").read_bytes()


def test_a_forked_process_writes_after_its_parent_did(tmp_path):
    """Mutation: no os.register_at_fork in splatcl/io/exr.py; the child then hangs."""
    frame = make_frame(make_aovs(64, 64))
    frame.save(tmp_path / "parent.exr")
    assert OpenEXR.global_thread_count() > 0
    child = multiprocessing.get_context("fork").Process(target=frame.save, args=(tmp_path / "child.exr",))
    child.start()
    child.join(timeout=60)
    try:
        assert child.exitcode == 0
    finally:
        child.kill()
    frame.save(tmp_path / "again.exr")
    files = {(tmp_path / f"{name}.exr").read_bytes() for name in ("parent", "child", "again")}
    assert len(files) == 1


def test_the_number_of_threads_is_left_to_a_program_that_chose_it_and_changes_no_byte(tmp_path):
    frame, written = make_frame(make_aovs(64, 64)), set()
    for threads in (1, 3):
        OpenEXR.set_global_thread_count(threads)
        frame.save(tmp_path / "a.exr")
        assert OpenEXR.global_thread_count() == threads
        written.add((tmp_path / "a.exr").read_bytes())
    assert len(written) == 1
