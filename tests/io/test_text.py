"""Points in text files, and scans in PTX files."""

import numpy as np
import pytest
from helpers.io_files import BYTES, NORMALS, POINTS, close, linear, put

import splatcl
from splatcl.io.inspect import inspect
from splatcl.scene.splats import DEFAULT_COLOR

TEXTS = [
    ("a.xyz", "{x:r} {y:r} {z:r}\n", ""),
    ("a.xyz", "{x:r},{y:r},{z:r}\r\n", ""),
    ("a.xyz", "  {x:r}\t{y:r};{z:r}  # here\n\n", ""),
    ("a.pts", "{x:r} {y:r} {z:r}\n", "5\n"),
    ("a.txt", "{x:r} {y:r} {z:r} 17\n", "# a comment\n// another\n5\n"),
    ("a.xyz", "{x:r} {y:r} {z:r} {n}\n", ""),
    ("a.pwn", "{x:r} {y:r} {z:r} {n}\n", "5\n"),
    ("a.xyz", "{x:r} {y:r} {z:r} {c}\n", ""),
    ("a.pts", "{x:r} {y:r} {z:r} -1200 {c}\n", "5\n"),
    ("a.xyz", "{x:r} {y:r} {z:r} {n} {c}\n", ""),
    ("a.xyz", "{x:r} {y:r} {z:r} {c} {n}\n", ""),
    ("a.csv", "{x:r},{y:r},{z:r},{n},9,{c}\n", "x,y,z,nx,ny,nz,label,red,green,blue\n"),
    ("a.txt", "{x:r} {y:r} {z:r} {c}\n", "//X Y Z R G B\n"),
]


@pytest.mark.parametrize(("name", "line", "head"), TEXTS)
def test_text_points(tmp_path, name, line, head):
    separator = "," if "," in line else " "
    body = "".join(
        line.replace(":r", "").format(
            x=repr(p[0]), y=repr(p[1]), z=repr(p[2]), n=separator.join(map(str, n)), c=separator.join(map(str, c))
        )
        for p, n, c in zip((POINTS + 0.1).tolist(), NORMALS.tolist(), BYTES.tolist(), strict=True)
    )
    splats = splatcl.read(put(tmp_path / name, head + body))
    np.testing.assert_array_equal(splats.center, POINTS + 0.1)  # float64, to the last bit
    assert splats.oriented == ("{n}" in line)
    if "{n}" in line:
        np.testing.assert_allclose(splats.normal, NORMALS, atol=1e-12)
    close(splats.color, linear(BYTES) if "{c}" in line else np.tile(DEFAULT_COLOR, (5, 1)))


def test_pwn_with_normals_after_all_points(tmp_path):
    text = "\n".join(["5", *[" ".join(map(str, row)) for row in [*POINTS.tolist(), *NORMALS.tolist()]]])
    splats = splatcl.read(put(tmp_path / "a.pwn", text))
    np.testing.assert_array_equal(splats.center, POINTS)
    np.testing.assert_allclose(splats.normal, NORMALS, atol=1e-12)


def test_decimal_colors_in_text_are_linear(tmp_path):
    text = "".join(f"{p[0]} {p[1]} {p[2]} 0.25 0.5 1\n" for p in POINTS)
    close(splatcl.read(put(tmp_path / "a.xyzrgb", text)).color, np.tile([0.25, 0.5, 1.0], (5, 1)))


def test_ptx_scans_are_placed_by_their_matrices(tmp_path):
    pose = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n"
    scans = ""
    for move in (10, 20):
        scans += f"1\n4\n{pose}0 1 0 0\n-1 0 0 0\n0 0 1 0\n{move} 0 0 1\n0 0 0 0.5 0 0 0\n"
        scans += "1 0 0 0.5 255 0 10\n0 2 0 0.5 0 0 0\n0 0 3 0.5 128 128 128\n"
    splats = splatcl.read(put(tmp_path / "a.ptx", scans))
    first = [[10, 1, 0], [8, 0, 0], [10, 0, 3]]  # row vectors times the matrix: a quarter turn about z, then the shift
    np.testing.assert_array_equal(splats.center, [*first, *np.add(first, (10, 0, 0))])
    close(splats.color[:3], linear([[255, 0, 10], [0, 0, 0], [128, 128, 128]]))
    assert "dropped 2 missing returns (points at 0 0 0)" in splats.notes


HOW = "took the {} numbers of a line as x y z {}; if wrong, name them in the first line"
COMMAS = "; took commas as separators: write decimal points, not commas"


@pytest.mark.parametrize(
    ("name", "line", "notes"),
    [
        ("a.xyz", "{} 1 0.5\n", []),
        ("a.pwn", "{} 1 0.5 0 0 1\n", []),
        ("a.xyz", "{} 1 0.5 0 0 1\n", [HOW.format(6, "nx ny nz")]),
        ("a.xyz", "{},1,0.5,7,8,9\n", [HOW.format(6, "red green blue")]),
        ("a.xyz", "{} 1 0.5 17\n", [HOW.format(4, "intensity"), "ignored column intensity"]),
        ("a.xyz", "{},5 1,25 -3,0 # m\n", [HOW.format(6, "nx ny nz") + COMMAS]),
        ("a.txt", "{},5;1,25;3,0\n", [HOW.format(6, "red green blue") + COMMAS]),
    ],
)
def test_guessed_columns_are_told(tmp_path, name, line, notes):
    path = put(tmp_path / name, "".join(line.format(i) for i in range(1, 6)))
    assert list(inspect(path).notes) == notes
    named = put(tmp_path / "b.csv", "x y z u v w\n" + "".join(f"{i} 0 0 0 0 1\n" for i in range(5)))
    assert inspect(named).notes == ("ignored columns u, v, w",)
