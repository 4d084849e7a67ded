"""Reading and writing: every format in its variants, made here byte by byte, and colours by hand."""

import os
import struct
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import tolerances as tol

import splatcl.io
from splatcl.splats import DEFAULT_COLOR, Splats

LINEAR = {0: 0.0, 10: 0.0030353, 128: 0.2158605, 188: 0.5028865, 255: 1.0}
"""8-bit sRGB to linear, by hand: 10 / 255 / 12.92, ((x / 255 + 0.055) / 1.055)^2.4."""

POINTS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0.5], [2, 0, 0.25]])
NORMALS = np.array([[0, 0, 1], [0, 0.6, 0.8], [0.6, 0, 0.8], [0, 0, -1], [1, 0, 0]])
BYTES = np.array([[0, 10, 128], [188, 255, 0], [128, 128, 128], [255, 0, 10], [10, 188, 255]])
FACES = [[0, 1, 2], [1, 3, 2], [1, 4, 3]]
SHARED = Path(__file__).parents[2] / "shared" / "data"


def linear(values):
    return np.vectorize(LINEAR.get)(values)


def close(color, expected):
    np.testing.assert_allclose(color, expected, atol=tol.COLOR_ABSOLUTE)


def put(path, data):
    path.write_bytes(data if isinstance(data, bytes) else data.encode())
    return path


def ply(form, elements, newline="\n", comments=()):
    """Return a PLY file of (name, [(type, property)], rows); a list property's type is "list uchar int"."""
    codes = {
        "char": "b",
        "uchar": "B",
        "short": "h",
        "ushort": "H",
        "int": "i",
        "uint": "I",
        "float": "f",
        "double": "d",
    }
    head = ["ply", f"format {form} 1.0", *[f"comment {c}" for c in comments]]
    body = b""
    for name, properties, rows in elements:
        head += [f"element {name} {len(rows)}", *[f"property {kind} {prop}" for kind, prop in properties]]
        for row in rows:
            words = []
            for (kind, _), value in zip(properties, row, strict=True):
                parts = kind.split()
                if parts[0] == "list":
                    words += [(codes[parts[1]], len(value)), *[(codes[parts[2]], v) for v in value]]
                else:
                    words.append((codes[kind], value))
            if form == "ascii":
                body += (" ".join(repr(v) for _, v in words) + newline).encode()
            else:
                order = "<" if "little" in form else ">"
                body += b"".join(struct.pack(order + c, v) for c, v in words)
    return newline.join([*head, "end_header", ""]).encode() + body


def xyz(kind="float"):
    return [(kind, name) for name in "xyz"]


def rows(*arrays):
    return [[v.item() for part in row for v in part] for row in zip(*map(np.asarray, arrays), strict=True)]


FORMS = ("ascii", "binary_little_endian", "binary_big_endian")


@pytest.mark.parametrize("newline", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("kind", ["float", "double"])
def test_ply_points(tmp_path, form, kind, newline):
    properties = [*xyz(kind), ("short", "odd"), *[("float", n) for n in ("nx", "ny", "nz")]]
    data = rows(POINTS, np.arange(5)[:, None], NORMALS)
    file = ply(form, [("vertex", properties, data), ("other", [("int", "a")], [[1], [2]])], newline)
    splats = splatcl.io.read(put(tmp_path / "a.ply", file))
    np.testing.assert_array_equal(splats.center, POINTS)
    assert splats.center.dtype == {"float": np.float32, "double": np.float64}[kind]
    np.testing.assert_allclose(splats.normal, NORMALS, atol=1e-6)
    assert splats.oriented
    close(splats.color, np.tile(DEFAULT_COLOR, (5, 1)))
    assert splats.notes[0] == "ignored odd, element other"


def test_ply_header_that_plyfile_refuses(tmp_path):
    file = ply("binary_little_endian", [("vertex", xyz(), rows(POINTS))], comments=["für Müller"])
    file = file.replace(b"element vertex 5\n", b"element vertex 5 \r\n").replace(b"end_header", b"end_header ")
    np.testing.assert_array_equal(splatcl.io.read(put(tmp_path / "a.ply", file)).center, POINTS)


@pytest.mark.parametrize("form", FORMS)
def test_ply_colors_of_every_type(tmp_path, form):
    names = ("red", "green", "blue")
    for kind, values, expected in [
        ("uchar", BYTES, linear(BYTES)),
        ("ushort", BYTES * 257, linear(BYTES)),
        ("int", BYTES, linear(BYTES)),
        ("float", BYTES / 255.0, BYTES / 255.0),
    ]:
        file = ply(form, [("vertex", [*xyz(), *[(kind, n) for n in names]], rows(POINTS, values))])
        close(splatcl.io.read(put(tmp_path / "a.ply", file)).color, expected)


def test_ply_radius_makes_circles(tmp_path):
    file = ply("ascii", [("vertex", [*xyz(), ("float", "radius")], rows(POINTS, np.full((5, 1), 0.5)))])
    splats = splatcl.io.read(put(tmp_path / "a.ply", file))
    for tangent in (splats.tangent_u, splats.tangent_v):
        np.testing.assert_allclose(np.linalg.norm(tangent, axis=1), 0.5, rtol=1e-6)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("name", ["vertex_indices", "vertex_index"])
def test_ply_mesh_of_triangles(tmp_path, form, name):
    faces = [("list uchar int", name)]
    file = ply(form, [("vertex", xyz(), rows(POINTS)), ("face", faces, [[f] for f in FACES])])
    splats = splatcl.io.read(put(tmp_path / "a.ply", file))
    assert any(note.startswith("covered 3 triangles") for note in splats.notes)
    assert (splats.normal[:, 2] > 0).all()


@pytest.mark.parametrize("form", FORMS)
def test_ply_mesh_of_polygons_with_face_colors(tmp_path, form):
    properties = [("list uchar uint", "vertex_indices"), *[("uchar", n) for n in ("red", "green", "blue")]]
    faces = [[[0, 1, 3, 2], 0, 0, 255], [[1, 4, 3], 255, 0, 0], [[0, 1], 0, 255, 0]]
    file = ply(form, [("vertex", xyz(), rows(POINTS)), ("face", properties, faces)])
    splats = splatcl.io.read(put(tmp_path / "a.ply", file))
    assert "left out 1 faces of fewer than 3 corners" in splats.notes
    np.testing.assert_array_equal(np.unique(splats.color, axis=0), [[0, 0, 1], [1, 0, 0]])
    red = splats.center[splats.color[:, 0] == 1]
    assert (red[:, 0] > 1).all()


@pytest.mark.parametrize("form", FORMS)
def test_ply_triangle_strips(tmp_path, form):
    strips = ("tristrips", [("list int int", "vertex_indices")], [[[0, 1, 2, 3, -1, 1, 4, 3]]])
    splats = splatcl.io.read(put(tmp_path / "a.ply", ply(form, [("vertex", xyz(), rows(POINTS)), strips])))
    assert any(note.startswith("covered 3 triangles") for note in splats.notes)
    assert (splats.normal[:, 2] > 0).all()  # every other triangle of a strip is turned


def test_ply_range_grid_is_points(tmp_path):
    scan = ("range_grid", [("list uchar int", "vertex_indices")], [[[0]], [[]], [[1]]])
    splats = splatcl.io.read(put(tmp_path / "a.ply", ply("binary_big_endian", [("vertex", xyz(), rows(POINTS)), scan])))
    np.testing.assert_array_equal(splats.center, POINTS)
    assert not splats.oriented


def gaussian(num_axes, **values):
    names = [*"xyz", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2", "f_rest_0", "opacity"]
    names += [f"scale_{i}" for i in range(num_axes)] + [f"rot_{i}" for i in range(4)]
    row = [values.get(name, 0.0) for name in names]
    return ply("binary_little_endian", [("vertex", [("float", n) for n in names], [row])])


def test_gaussians_become_discs_of_the_two_longest_axes(tmp_path):
    half = np.sqrt(0.5)
    file = gaussian(
        3, x=1, y=2, z=3, f_dc_0=1, f_dc_1=0, f_dc_2=-4,
        scale_0=0, scale_1=np.log(2), scale_2=np.log(0.5), rot_0=3 * half, rot_3=3 * half,
    )  # fmt: skip
    splats = splatcl.io.read(put(tmp_path / "a.ply", file))
    # A quarter turn about z takes the axes x, y to y, -x; rims are at 2 sigma.
    np.testing.assert_allclose(splats.tangent_u, [[-4, 0, 0]], atol=1e-6)
    np.testing.assert_allclose(splats.tangent_v, [[0, 2, 0]], atol=1e-6)
    close(splats.color, [[0.5739225, 0.2140411, 0.0]])  # sRGB 0.5 + 0.2820948 f_dc = 0.7820948, 0.5, below 0
    assert not splats.oriented
    assert splats.notes == (
        "read Gaussians as opaque discs of 2 sigma; ignored opacity and view-dependent colour (f_rest)",
    )


def test_gaussians_of_two_axes(tmp_path):
    file = gaussian(2, scale_0=np.log(3), scale_1=0, rot_0=1)
    splats = splatcl.io.read(put(tmp_path / "a.ply", file))
    np.testing.assert_allclose(splats.tangent_u, [[6, 0, 0]], atol=1e-6)
    np.testing.assert_allclose(splats.tangent_v, [[0, 2, 0]], atol=1e-6)


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
    splats = splatcl.io.read(put(tmp_path / name, head + body))
    np.testing.assert_array_equal(splats.center, POINTS + 0.1)  # float64, to the last bit
    assert splats.oriented == ("{n}" in line)
    if "{n}" in line:
        np.testing.assert_allclose(splats.normal, NORMALS, atol=1e-12)
    close(splats.color, linear(BYTES) if "{c}" in line else np.tile(DEFAULT_COLOR, (5, 1)))


def test_pwn_with_normals_after_all_points(tmp_path):
    text = "\n".join(["5", *[" ".join(map(str, row)) for row in [*POINTS.tolist(), *NORMALS.tolist()]]])
    splats = splatcl.io.read(put(tmp_path / "a.pwn", text))
    np.testing.assert_array_equal(splats.center, POINTS)
    np.testing.assert_allclose(splats.normal, NORMALS, atol=1e-12)


def test_decimal_colors_in_text_are_linear(tmp_path):
    text = "".join(f"{p[0]} {p[1]} {p[2]} 0.25 0.5 1\n" for p in POINTS)
    close(splatcl.io.read(put(tmp_path / "a.xyzrgb", text)).color, np.tile([0.25, 0.5, 1.0], (5, 1)))


def test_ptx_scans_are_placed_by_their_matrices(tmp_path):
    pose = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n"
    scans = ""
    for move in (10, 20):
        scans += f"1\n4\n{pose}0 1 0 0\n-1 0 0 0\n0 0 1 0\n{move} 0 0 1\n0 0 0 0.5 0 0 0\n"
        scans += "1 0 0 0.5 255 0 10\n0 2 0 0.5 0 0 0\n0 0 3 0.5 128 128 128\n"
    splats = splatcl.io.read(put(tmp_path / "a.ptx", scans))
    first = [[10, 1, 0], [8, 0, 0], [10, 0, 3]]  # a quarter turn about z, then the move; rows times matrix
    np.testing.assert_array_equal(splats.center, [*first, *np.add(first, (10, 0, 0))])
    close(splats.color[:3], linear([[255, 0, 10], [0, 0, 0], [128, 128, 128]]))
    assert "left out 2 missing returns (points at 0 0 0)" in splats.notes


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
        splats = splatcl.io.read(tmp_path / "a.pcd")
        np.testing.assert_array_equal(splats.center, POINTS)
        np.testing.assert_allclose(splats.normal, NORMALS, atol=1e-6)
        if not (encoding == "ascii" and last.dtype == np.float32):  # text loses bits of a colour in a float
            close(splats.color, linear(BYTES))
        assert "ignored curvature" in splats.notes


def test_pcd_ascii_with_other_blanks_and_missing_returns(tmp_path):
    head = "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 2\nHEIGHT 2\n"
    head += "VIEWPOINT 0 0 0 1 0 0 0\nPOINTS 4\nDATA ascii\n"
    path = put(tmp_path / "a.pcd", head + "0 0 0 \n1  0\t0\nnan nan nan\n0 1 0\n")
    splats = splatcl.io.read(path, on_invalid="drop")
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
        splats = splatcl.io.read(tmp_path / name)
        np.testing.assert_array_equal(splats.center, POINTS + origin)
        close(splats.color, expected)
        assert ("colours are 8-bit values in 16-bit fields" in splats.notes) == (scale == 1)


def test_las_without_color(tmp_path):
    import laspy

    survey = laspy.LasData(laspy.LasHeader(version="1.2", point_format=3))
    survey.x, survey.y, survey.z = POINTS.T
    survey.write(tmp_path / "a.las")
    splats = splatcl.io.read(tmp_path / "a.las")
    close(splats.color, np.tile(DEFAULT_COLOR, (5, 1)))
    assert "ignored colours: all are zero" in splats.notes


OBJ = "".join(f"v {p[0]} {p[1]} {p[2]}\n" for p in POINTS)


@pytest.mark.parametrize(
    "faces",
    [
        "f 1 2 3\nf 2 4 3\nf 2 5 4\n",
        "vt 0 0\nvn 0 0 1\nf 1/1/1 2/1/1 3/1/1\nf 2//1 4//1 3//1\nf 2/1 5/1 4/1\n",
        "o thing\ng part\nusemtl m\nf -5 -4 \\\n -3\nf -4 -2 -3\nf -4 -1 -2\n",
        "f 1 2 4 3\nf 2 5 4\n",
    ],
)
def test_obj_mesh(tmp_path, faces):
    splats = splatcl.io.read(put(tmp_path / "a.obj", OBJ + faces))
    assert any(note.startswith("covered 3 triangles") for note in splats.notes)
    assert (splats.normal[:, 2] > 0).all()


def test_obj_relative_indices_count_from_their_line(tmp_path):
    text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\nv 9 9 9\nv 9 8 9\n"
    assert splatcl.io.read(put(tmp_path / "a.obj", text)).center.max() < 1


def test_obj_points_with_colors_and_normals(tmp_path):
    text = "".join(f"v {p[0]} {p[1]} {p[2]} 0.01 0.25 1\n" for p in POINTS)
    text += "".join(f"vn {n[0]} {n[1]} {n[2]}\n" for n in NORMALS)
    splats = splatcl.io.read(put(tmp_path / "a.obj", text))
    np.testing.assert_array_equal(splats.center, POINTS)
    np.testing.assert_allclose(splats.normal, NORMALS, atol=1e-12)
    close(splats.color, np.tile([0.01, 0.25, 1.0], (5, 1)))


@pytest.mark.parametrize("head", ["OFF\n5 3 0\n", "OFF 5 3 0\n", "# made by hand\nOFF # yes\n\n5 3 0\n"])
def test_off(tmp_path, head):
    text = head + OBJ.replace("v ", "") + "3 0 1 2\n3 1 3 2\n3 1 4 3\n"
    splats = splatcl.io.read(put(tmp_path / "a.off", text))
    assert any(note.startswith("covered 3 triangles") for note in splats.notes)
    close(splats.color, np.tile(DEFAULT_COLOR, (len(splats), 1)))


@pytest.mark.parametrize(("word", "color", "expected"), [("COFF", "128 10 255 255", [128, 10, 255]), ("OFF", "", [])])
def test_off_colors_of_vertices_and_faces(tmp_path, word, color, expected):
    text = f"{word}\n5 3 0\n" + OBJ.replace("v ", "").replace("\n", f" {color}\n")
    text += "4 0 1 3 2 {0}\n3 1 4 3 {0}\n0 {0}\n".format("188 0 0" if not color else "")
    splats = splatcl.io.read(put(tmp_path / "a.off", text))
    close(splats.color, np.tile(linear(expected or [188, 0, 0]), (len(splats), 1)))


def test_off_decimal_colors_are_linear(tmp_path):
    text = "COFF\n5 0 0\n" + OBJ.replace("v ", "").replace("\n", " 0.25 0.5 1.0\n")
    close(splatcl.io.read(put(tmp_path / "a.off", text)).color, np.tile([0.25, 0.5, 1.0], (5, 1)))


@pytest.mark.parametrize("binary", [True, False])
def test_stl(tmp_path, binary):
    corners = POINTS[FACES]
    if binary:
        body = b"".join(struct.pack("<12fH", *[0] * 3, *t.ravel(), 0) for t in corners)
        data = b"solid in name only".ljust(80) + struct.pack("<I", 3) + body
    else:
        facet = "facet normal 0 0 1\nouter loop\n{}endloop\nendfacet\n"
        data = (
            "solid a\n"
            + "".join(facet.format("".join(f"vertex {p[0]} {p[1]} {p[2]}\n" for p in t)) for t in corners)
            + "endsolid a\n"
        )
    splats = splatcl.io.read(put(tmp_path / "a.stl", data))
    assert any(note.startswith("covered 3 triangles") for note in splats.notes)
    assert (splats.normal[:, 2] > 0).all()


def test_glb_scene_is_placed_and_keeps_linear_colors(tmp_path):
    import trimesh

    scene = trimesh.Scene()
    mesh = trimesh.Trimesh(POINTS, FACES, process=False)
    mesh.visual.vertex_colors = np.tile(np.uint8([51, 102, 255, 255]), (5, 1))
    move, mirror = np.eye(4), np.diag([1.0, 1.0, -1.0, 1.0])
    move[:3, 3] = 10, 0, 0
    scene.add_geometry(mesh, "one", transform=move)
    scene.add_geometry(mesh, "two", transform=mirror)
    splats = splatcl.io.read(put(tmp_path / "a.glb", scene.export(file_type="glb")))
    close(splats.color, np.tile([0.2, 0.4, 1.0], (len(splats), 1)))
    moved = splats.center[:, 0] > 5
    np.testing.assert_array_equal(splats.normal[moved, 2] > 0, True)
    np.testing.assert_array_equal(splats.normal[~moved, 2] < 0, True)
    assert splats.bounds[0, 2] < -0.4


def test_glviz_raw(tmp_path):
    data = struct.pack("<I15f", 5, *POINTS.ravel()) + struct.pack("<I9I", 3, *np.ravel(FACES))
    splats = splatcl.io.read(put(tmp_path / "a.raw", data))
    assert any(note.startswith("covered 3 triangles") for note in splats.notes)
    assert splats.center.dtype == np.float32


def native(dtype=np.float64, oriented=True, num=50):
    rng = np.random.default_rng(9)
    arrays = [rng.normal(size=(num, 3)).astype(dtype) for _ in range(3)]
    color = rng.random((num, 3)).astype(np.float32)
    return Splats(*arrays, color, oriented=oriented, num_dropped=3, notes=('gemacht für "splatcl"\nzwei',))


@pytest.mark.parametrize("name", ["a.ply", "a.npz"])
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("oriented", [True, False])
@pytest.mark.parametrize("num", [0, 50])
def test_native_round_trip_is_exact(tmp_path, name, dtype, oriented, num):
    splats = native(dtype, oriented, num)
    splatcl.io.write(splats, tmp_path / name)
    again = splatcl.io.read(tmp_path / name)
    for field in ("center", "tangent_u", "tangent_v", "color"):
        one, two = getattr(splats, field), getattr(again, field)
        assert one.dtype == two.dtype
        assert one.tobytes() == two.tobytes()
    for field in ("oriented", "num_dropped", "notes"):
        assert getattr(splats, field) == getattr(again, field)


@pytest.mark.parametrize("name", ["a.ply", "a.npz"])
def test_native_bytes_do_not_depend_on_when_or_where(tmp_path, name, monkeypatch):
    splatcl.io.write(native(), tmp_path / name)
    (tmp_path / "sub").mkdir()
    monkeypatch.setattr(time, "time", lambda: 1.5e9)
    splatcl.io.write(native(), tmp_path / "sub" / name)
    assert (tmp_path / name).read_bytes() == (tmp_path / "sub" / name).read_bytes()
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted([name, "sub"])  # no temporary file is left


def test_native_ply_is_plain_ply(tmp_path):
    splatcl.io.write(native(np.float32), tmp_path / "a.ply")
    head = (tmp_path / "a.ply").read_bytes().partition(b"end_header\n")[0].decode()
    assert "format binary_little_endian 1.0" in head
    assert [line.split()[2] for line in head.splitlines() if line.startswith("property float")] == [
        "x", "y", "z", "tu_x", "tu_y", "tu_z", "tv_x", "tv_y", "tv_z", "red", "green", "blue",
    ]  # fmt: skip


def test_type_is_known_by_first_bytes_where_the_extension_is_not(tmp_path):
    splatcl.io.write(native(), tmp_path / "a.ply")
    (tmp_path / "a.ply").rename(tmp_path / "splats")
    assert len(splatcl.io.read(tmp_path / "splats")) == 50


def test_inspect_counts_and_names_what_would_be_skipped(tmp_path):
    data = rows(POINTS, BYTES, [[0, 0, 1]] * 5)
    data[1][0], data[2][8] = float("nan"), 0.0
    names = [*xyz(), *[("uchar", n) for n in ("red", "green", "blue")], *[("float", n) for n in ("nx", "ny", "nz")]]
    summary = splatcl.io.inspect(put(tmp_path / "a.ply", ply("binary_big_endian", [("vertex", names, data)])))
    assert summary.format == "PLY (binary big-endian)"
    assert (summary.num_points, summary.num_faces) == (5, 0)
    assert summary.attributes == ("normals", "color")
    np.testing.assert_array_equal(summary.bounds, [[0, 0, 0], [2, 1, 0.5]])
    assert summary.skipped == (
        (1, "points with a non-finite coordinate"),
        (1, "points with a zero or non-finite normal"),
    )
    np.testing.assert_allclose(summary.spacing, (1 + np.sqrt(1.25)) / 2)  # of 1, 1, 1.118, 1.436


def test_inspect_mesh_and_native(tmp_path):
    text = "OFF\n5 4 0\n" + OBJ.replace("v ", "") + "3 0 1 2\n3 1 3 2\n3 1 4 3\n3 1 1 2\n"
    summary = splatcl.io.inspect(put(tmp_path / "a.off", text))
    assert (summary.num_points, summary.num_faces) == (5, 4)
    assert summary.skipped == ((1, "triangles with no area"),)
    splatcl.io.write(native(), tmp_path / "a.npz")
    summary = splatcl.io.inspect(tmp_path / "a.npz")
    assert (summary.num_points, summary.attributes, summary.skipped) == (50, ("color", "tangents"), ())


@pytest.mark.parametrize(
    ("name", "data", "axis"),
    [
        ("a.LAZ", None, "z"),  # there is no such file
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
    assert splatcl.io.up_axis(tmp_path / name) == axis


def test_import_is_light():
    heavy = "scipy", "trimesh", "laspy", "plyfile", "pypcd4"
    code = f"import sys, splatcl.io; print([m for m in {heavy} if m in sys.modules])"
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
    summary = splatcl.io.inspect(SHARED / name)
    assert (summary.num_points, summary.num_faces) == SHARED_COUNTS[name]
    assert len(splatcl.io.read(SHARED / name)) >= max(summary.num_points if not summary.num_faces else 0, 1)


@pytest.mark.skipif(not (SHARED / "1.2-with-color.las").exists(), reason="the shared files are not here")
def test_one_survey_in_three_formats():
    las, laz, ptx = (splatcl.io.read(SHARED / n) for n in ("1.2-with-color.las", "simple.laz", "1.2-with-color.ptx"))
    np.testing.assert_array_equal(las.center, laz.center)
    np.testing.assert_allclose(las.center, ptx.center, atol=1e-3)
    np.testing.assert_array_equal(las.color, ptx.color)
