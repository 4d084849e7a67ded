"""OBJ, OFF, STL, GLB and RAW meshes."""

import struct

import numpy as np
import pytest
from helpers.io_files import FACES, NORMALS, OBJ, POINTS, close, linear, put

import splatcl
from splatcl.scene.splats import DEFAULT_COLOR


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
    splats = splatcl.read(put(tmp_path / "a.obj", OBJ + faces))
    assert any(note.startswith("covered 3 triangles") for note in splats.notes)
    assert (splats.normal[:, 2] > 0).all()


def test_obj_relative_indices_count_from_their_line(tmp_path):
    text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\nv 9 9 9\nv 9 8 9\n"
    assert splatcl.read(put(tmp_path / "a.obj", text)).center.max() < 1


def test_obj_points_with_colors_and_normals(tmp_path):
    text = "".join(f"v {p[0]} {p[1]} {p[2]} 0.01 0.25 1\n" for p in POINTS)
    text += "".join(f"vn {n[0]} {n[1]} {n[2]}\n" for n in NORMALS)
    splats = splatcl.read(put(tmp_path / "a.obj", text))
    np.testing.assert_array_equal(splats.center, POINTS)
    np.testing.assert_allclose(splats.normal, NORMALS, atol=1e-12)
    close(splats.color, np.tile([0.01, 0.25, 1.0], (5, 1)))


@pytest.mark.parametrize("head", ["OFF\n5 3 0\n", "OFF 5 3 0\n", "# made by hand\nOFF # yes\n\n5 3 0\n"])
def test_off(tmp_path, head):
    text = head + OBJ.replace("v ", "") + "3 0 1 2\n3 1 3 2\n3 1 4 3\n"
    splats = splatcl.read(put(tmp_path / "a.off", text))
    assert any(note.startswith("covered 3 triangles") for note in splats.notes)
    close(splats.color, np.tile(DEFAULT_COLOR, (len(splats), 1)))


@pytest.mark.parametrize(("word", "color", "expected"), [("COFF", "128 10 255 255", [128, 10, 255]), ("OFF", "", [])])
def test_off_colors_of_vertices_and_faces(tmp_path, word, color, expected):
    text = f"{word}\n5 3 0\n" + OBJ.replace("v ", "").replace("\n", f" {color}\n")
    text += "4 0 1 3 2 {0}\n3 1 4 3 {0}\n0 {0}\n".format("188 0 0" if not color else "")
    splats = splatcl.read(put(tmp_path / "a.off", text))
    close(splats.color, np.tile(linear(expected or [188, 0, 0]), (len(splats), 1)))


def test_off_decimal_colors_are_linear(tmp_path):
    text = "COFF\n5 0 0\n" + OBJ.replace("v ", "").replace("\n", " 0.25 0.5 1.0\n")
    close(splatcl.read(put(tmp_path / "a.off", text)).color, np.tile([0.25, 0.5, 1.0], (5, 1)))


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
    splats = splatcl.read(put(tmp_path / "a.stl", data))
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
    splats = splatcl.read(put(tmp_path / "a.glb", scene.export(file_type="glb")))
    close(splats.color, np.tile([0.2, 0.4, 1.0], (len(splats), 1)))
    moved = splats.center[:, 0] > 5
    np.testing.assert_array_equal(splats.normal[moved, 2] > 0, True)
    np.testing.assert_array_equal(splats.normal[~moved, 2] < 0, True)
    assert splats.bounds[0, 2] < -0.4


def test_glviz_raw(tmp_path):
    data = struct.pack("<I15f", 5, *POINTS.ravel()) + struct.pack("<I9I", 3, *np.ravel(FACES))
    splats = splatcl.read(put(tmp_path / "a.raw", data))
    assert any(note.startswith("covered 3 triangles") for note in splats.notes)
    assert splats.center.dtype == np.float32
