"""PCD, LAS and LAZ files."""

import numpy as np
import pytest
from helpers.io_files import BYTES, NORMALS, POINTS, close, linear, put

import splatcl
from splatcl.errors import FileError
from splatcl.scene.splats import DEFAULT_COLOR


@pytest.mark.parametrize("encoding", ["ascii", "binary", "binary_compressed"])
def test_pcd(tmp_path, encoding):
    from pypcd4 import Encoding, PointCloud

    packed = (BYTES[:, 0] << 16 | BYTES[:, 1] << 8 | BYTES[:, 2]).astype(np.uint32)
    names = ("x", "y", "z", "normal_x", "normal_y", "normal_z", "curvature", "rgb")
    columns = [*POINTS.T, *NORMALS.T, np.zeros(5)]
    for last in (packed, packed.view(np.float32)):
        types = [np.float32] * 7 + [last.dtype.type]
        cloud = PointCloud.from_points([*[c.astype(np.float32) for c in columns], last], names, types)
        cloud.save(tmp_path / "a.pcd", Encoding(encoding))
        splats = splatcl.read(tmp_path / "a.pcd")
        np.testing.assert_array_equal(splats.center, POINTS)
        np.testing.assert_allclose(splats.normal, NORMALS, atol=1e-6)
        if not (encoding == "ascii" and last.dtype == np.float32):  # text loses bits of a color in a float
            close(splats.color, linear(BYTES))
        assert "ignored curvature" in splats.notes


def test_pcd_ascii_with_other_blanks_and_missing_returns(tmp_path):
    head = "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 2\nHEIGHT 2\n"
    head += "VIEWPOINT 0 0 0 1 0 0 0\nPOINTS 4\nDATA ascii\n"
    path = put(tmp_path / "a.pcd", head + "0 0 0 \n1  0\t0\nnan nan nan\n0 1 0\n")
    splats = splatcl.read(path, on_invalid="drop")
    np.testing.assert_array_equal(splats.center, [[0, 0, 0], [1, 0, 0], [0, 1, 0]])
    assert splats.num_dropped == 1


@pytest.mark.parametrize(("name", "version", "form"), [("a.las", "1.2", 3), ("a.laz", "1.2", 3), ("a.laz", "1.4", 7)])
def test_las(tmp_path, name, version, form):
    import laspy

    origin = np.array([637012.25, 849028.5, 431.75])
    for scale, expected in [(257, linear(BYTES)), (1, linear(BYTES))]:
        header = laspy.LasHeader(version=version, point_format=form)
        header.offsets, header.scales = origin, np.full(3, 0.25)
        survey = laspy.LasData(header)
        survey.x, survey.y, survey.z = (POINTS + origin).T
        survey.red, survey.green, survey.blue = (BYTES * scale).T.astype(np.uint16)
        survey.write(tmp_path / name)
        splats = splatcl.read(tmp_path / name)
        np.testing.assert_array_equal(splats.center, POINTS + origin)
        close(splats.color, expected)
        assert ("took colors as 8-bit values in 16-bit fields" in splats.notes) == (scale == 1)


def test_las_without_color(tmp_path):
    import laspy

    survey = laspy.LasData(laspy.LasHeader(version="1.2", point_format=3))
    survey.x, survey.y, survey.z = POINTS.T
    survey.write(tmp_path / "a.las")
    splats = splatcl.read(tmp_path / "a.las")
    close(splats.color, np.tile(DEFAULT_COLOR, (5, 1)))
    assert "ignored colors: all are zero" in splats.notes


@pytest.mark.parametrize(
    ("encoding", "missing"),
    [
        ("ascii", "has 2 of 3 numbers: 1 are missing"),
        ("binary", " 5 are missing"),
        ("binary_compressed", " 5 are missing"),
    ],
)
def test_a_cut_pcd_says_what_is_missing(tmp_path, encoding, missing):
    from pypcd4 import Encoding, PointCloud

    path = tmp_path / "a.pcd"
    PointCloud.from_xyz_points(POINTS.astype(np.float32)).save(path, Encoding(encoding))
    whole = path.read_bytes()
    path.write_bytes(whole.rstrip().rpartition(b" ")[0] if encoding == "ascii" else whole[:-5])
    with pytest.raises(FileError) as caught:
        splatcl.read(path)
    assert str(caught.value).startswith(f"{path}: ") and missing in str(caught.value)
    assert str(caught.value).endswith("the file is truncated")
