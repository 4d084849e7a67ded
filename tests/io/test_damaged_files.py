"""Damaged files: any change of bytes gives splats or one clear line, and soon."""

import struct
import time

import numpy as np
import pytest
from helpers.io_files import FACE, PCD, PLY, PTX, RAW, STL, XYZ_ROWS, one_splat
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import splatcl
from splatcl.errors import FileError, SplatclError
from splatcl.scene.splats import Splats


def laz_bytes(folder, name="a.laz"):
    import laspy

    survey = laspy.LasData(laspy.LasHeader(version="1.2", point_format=3))
    survey.x, survey.y, survey.z = np.random.default_rng(1).random((3, 20))
    survey.write(folder / name)
    return (folder / name).read_bytes()


@pytest.mark.parametrize("name", ["a.las", "a.laz"])
@pytest.mark.parametrize("place", [96, 100, 105, 107])
def test_damaged_counts_of_a_survey_are_refused_at_once(tmp_path, name, place):
    data = bytearray(laz_bytes(tmp_path, name))
    data[place : place + 4] = b"\xff\xff\xff\xff"
    (tmp_path / name).write_bytes(data)
    start = time.perf_counter()
    with pytest.raises(FileError, match=r"byte (96|105)|not a readable LAZ"):
        splatcl.read(tmp_path / name)
    assert time.perf_counter() - start < 5


def test_damaged_chunk_table_of_a_laz_is_refused(tmp_path):
    data = bytearray(laz_bytes(tmp_path))
    table = struct.unpack_from("<q", data, struct.unpack_from("<I", data, 96)[0])[0]
    data[table + 4 : table + 8] = b"\xff\xff\xff\xff"  # lazrs aborts the whole process at this
    (tmp_path / "a.laz").write_bytes(data)
    with pytest.raises(FileError, match="damaged or truncated"):
        splatcl.read(tmp_path / "a.laz")


@pytest.fixture(scope="module")
def small_files(tmp_path_factory):
    """Return (folder, {name: bytes}) of one small valid file of each kind."""
    from pypcd4 import Encoding, PointCloud

    folder = tmp_path_factory.mktemp("fuzz")
    points = np.random.default_rng(2).random((8, 3)).astype(np.float32)
    files = {
        "a.xyz": ("0.5 2 3\n" * 3 + XYZ_ROWS).encode(),
        "a.pts": ("3\n" + XYZ_ROWS.replace("\n", " 7 10 20 255\n")).encode(),
        "a.ptx": PTX.format(2).encode(),
        "ascii.ply": (PLY + FACE + XYZ_ROWS + "3 0 1 2\n").encode(),
        "binary.ply": (PLY.replace("ascii", "binary_big_endian") + FACE).encode()
        + struct.pack(">9fB3i", 0, 0, 0, 1, 0, 0, 0, 1, 0, 3, 0, 1, 2),
        "ascii.pcd": PCD.format(3).encode(),
        "a.obj": ("v " + XYZ_ROWS.replace("\n", "\nv ", 2) + "f 1 2 3\n").encode(),
        "a.off": ("COFF\n3 1 0\n" + XYZ_ROWS.replace("\n", " 9 99 255\n") + "3 0 1 2\n").encode(),
        "a.stl": STL,
        "a.raw": RAW,
        "a.laz": laz_bytes(folder),
        "a.las": laz_bytes(folder, "a.las"),
    }
    for encoding in (Encoding.BINARY, Encoding.BINARY_COMPRESSED):
        PointCloud.from_xyz_points(points).save(folder / "p.pcd", encoding)
        files[f"{encoding.value}.pcd"] = (folder / "p.pcd").read_bytes()
    for name in ("native.ply", "native.npz"):
        splatcl.write(one_splat(), folder / name)
        files[name] = (folder / name).read_bytes()
    return folder, files


EDIT = st.tuples(
    st.integers(0, 2000),
    st.sampled_from(["set", "insert", "delete", "cut"]),
    st.one_of(st.binary(min_size=1, max_size=4), st.sampled_from([b"-1", b"nan", b"\n", b" ", b"9" * 12, b"\xff" * 4])),
)


@settings(
    max_examples=400, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.data(), edits=st.lists(EDIT, min_size=1, max_size=4))
def test_damaged_bytes_give_splats_or_a_clear_error(small_files, data, edits):
    folder, files = small_files
    name = data.draw(st.sampled_from(sorted(files)))
    content = bytearray(files[name])
    for place, kind, new in edits:
        place %= len(content) + 1
        end = {"set": place + len(new), "insert": place, "delete": place + len(new), "cut": len(content)}[kind]
        content[place:end] = new if kind in ("set", "insert") else b""
    path = folder / f"damaged_{name}"
    path.write_bytes(content)
    start = time.perf_counter()
    try:
        assert isinstance(splatcl.read(path, data.draw(st.sampled_from(["error", "drop"]))), Splats)
    except SplatclError as error:
        assert str(error).startswith(f"{path}: ")
        assert "\n" not in str(error)
    assert time.perf_counter() - start < 10
