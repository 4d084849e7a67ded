"""Reading as a whole: choice of the reader, summary of a file, up axis, real files."""

import os
import subprocess
import sys

import numpy as np
import pytest
from helpers.io_files import BYTES, OBJ, POINTS, gaussian, native, ply, put, rows, xyz
from helpers.paths import ROOT

import splatcl
from splatcl.io.inspect import inspect
from splatcl.io.read import up_axis

SHARED = ROOT.parent / "shared" / "data"


def test_type_is_known_by_first_bytes_where_the_extension_is_not(tmp_path):
    splatcl.write(native(), tmp_path / "a.ply")
    (tmp_path / "a.ply").rename(tmp_path / "splats")
    assert len(splatcl.read(tmp_path / "splats")) == 50


def test_inspect_counts_and_names_what_would_be_skipped(tmp_path):
    data = rows(POINTS, BYTES, [[0, 0, 1]] * 5)
    data[1][0], data[2][8] = float("nan"), 0.0
    names = [*xyz(), *[("uchar", n) for n in ("red", "green", "blue")], *[("float", n) for n in ("nx", "ny", "nz")]]
    summary = inspect(put(tmp_path / "a.ply", ply("binary_big_endian", [("vertex", names, data)])))
    assert summary.format == "PLY (binary big-endian)"
    assert (summary.num_points, summary.num_faces) == (5, 0)
    assert summary.attributes == ("normals", "color")
    np.testing.assert_array_equal(summary.bounds, [[0, 0, 0], [2, 1, 0.5]])
    assert summary.skipped == (
        (1, "points with a non-finite coordinate"),
        (1, "points with a zero or non-finite normal"),
    )
    np.testing.assert_allclose(summary.spacing, (1 + np.sqrt(1.25)) / 2)  # the median of 1, 1, 1.118, 1.436


def test_inspect_mesh_and_native(tmp_path):
    text = "OFF\n5 4 0\n" + OBJ.replace("v ", "") + "3 0 1 2\n3 1 3 2\n3 1 4 3\n3 1 1 2\n"
    summary = inspect(put(tmp_path / "a.off", text))
    assert (summary.num_points, summary.num_faces) == (5, 4)
    assert summary.skipped == ((1, "triangles with no area"),)
    splatcl.write(native(), tmp_path / "a.npz")
    summary = inspect(tmp_path / "a.npz")
    assert (summary.num_points, summary.attributes, summary.skipped) == (50, ("color", "tangents"), ())


@pytest.mark.parametrize(
    ("name", "data", "axis"),
    [
        ("a.LAZ", None, "z"),  # no such file exists
        ("a.las", b"LASF", "z"),
        ("a", b"LASF", "z"),
        ("a.ptx", b"1", "z"),
        ("a.ply", ply("ascii", [("vertex", xyz(), rows(POINTS))]), "y"),
        ("a.ply", gaussian(3), "-y"),
        ("a.bin", gaussian(2), "-y"),
        ("a.ply", gaussian(3).replace(b"\n", b"\r\n"), "-y"),
        ("a.ply", b"ply\nno header", "y"),
        ("a.pts", b"1", "y"),
        ("a", b"", "y"),
    ],
)
def test_up_axis(tmp_path, name, data, axis):
    if data is not None:
        put(tmp_path / name, data)
    assert up_axis(tmp_path / name) == axis


def test_import_is_light():
    heavy = "scipy", "trimesh", "laspy", "plyfile", "pypcd4"
    code = f"import sys, splatcl.io.read; print([m for m in {heavy} if m in sys.modules])"
    env = {**os.environ, "PYTHONWARNINGS": "default"}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=env, check=True)
    assert done.stdout.strip() == "[]"


SHARED_COUNTS = {
    "fandisk.off": (6475, 12946), "armadillo.off": (26002, 52000), "dino.off": (3916, 7828), "kitten.xyz": (5210, 0),
    "oni.pwn": (1435, 0), "poste_france.xyz": (9031, 0), "laurana_3dhop.ply": (25160, 50000),
    "frag_color_small.ply": (3017, 5537), "cloud_bin_0_feature.pcd": (3903, 0), "bun0.pcd": (397, 0),
    "sample_c.las": (14408, 0), "1.2-with-color.las": (1065, 0), "1.2-with-color.ptx": (1065, 0),
    "simple.laz": (1065, 0), "spot.obj": (2930, 5856), "bun_zipper_res2.ply": (8171, 16301),
    "ArmadilloBack_1.ply": (12150, 0), "stanford_dragon_v40k_f80k.raw": (39994, 79988),
    "train-1000.gs.ply": (1000, 0), "tiny_mesh_be_color.ply": (114, 224), "bunnyData.pts": (30571, 0),
    "odd/draco_delim_test_bare_cr.ply": (24, 12), "odd/pear_nan_tristrips.ply": (10759, 21504),
}  # fmt: skip


@pytest.mark.parametrize("name", [n for n in SHARED_COUNTS if (SHARED / n).exists()])
def test_real_files(name):
    summary = inspect(SHARED / name)
    assert (summary.num_points, summary.num_faces) == SHARED_COUNTS[name]
    assert len(splatcl.read(SHARED / name)) >= max(summary.num_points if not summary.num_faces else 0, 1)


@pytest.mark.skipif(not (SHARED / "1.2-with-color.las").exists(), reason="the shared files are not here")
def test_one_survey_in_three_formats():
    las, laz, ptx = (splatcl.read(SHARED / n) for n in ("1.2-with-color.las", "simple.laz", "1.2-with-color.ptx"))
    np.testing.assert_array_equal(las.center, laz.center)
    np.testing.assert_allclose(las.center, ptx.center, atol=1e-3)
    np.testing.assert_array_equal(las.color, ptx.color)
