"""PLY files: points, meshes, strips, Gaussians."""

import numpy as np
import pytest
from helpers.io_files import BYTES, FACES, NORMALS, POINTS, close, gaussian, linear, ply, put, rows, xyz

import splatcl
from splatcl.io.read import load_model
from splatcl.io.readers.color import linear_integers, srgb_to_linear
from splatcl.scene.splats import DEFAULT_COLOR

FORMS = ("ascii", "binary_little_endian", "binary_big_endian")


@pytest.mark.parametrize("newline", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("kind", ["float", "double"])
def test_ply_points(tmp_path, form, kind, newline):
    properties = [*xyz(kind), ("short", "odd"), *[("float", n) for n in ("nx", "ny", "nz")]]
    data = rows(POINTS, np.arange(5)[:, None], NORMALS)
    file = ply(form, [("vertex", properties, data), ("other", [("int", "a")], [[1], [2]])], newline)
    splats = splatcl.read(put(tmp_path / "a.ply", file))
    np.testing.assert_array_equal(splats.center, POINTS)
    assert splats.center.dtype == {"float": np.float32, "double": np.float64}[kind]
    np.testing.assert_allclose(splats.normal, NORMALS, atol=1e-6)
    assert splats.oriented
    close(splats.color, np.tile(DEFAULT_COLOR, (5, 1)))
    assert splats.notes[0] == "ignored odd, element other"


def test_ply_header_that_plyfile_refuses(tmp_path):
    file = ply("binary_little_endian", [("vertex", xyz(), rows(POINTS))], comments=["für Müller"])
    file = file.replace(b"element vertex 5\n", b"element vertex 5 \r\n").replace(b"end_header", b"end_header ")
    np.testing.assert_array_equal(splatcl.read(put(tmp_path / "a.ply", file)).center, POINTS)


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
        close(splatcl.read(put(tmp_path / "a.ply", file)).color, expected)


@pytest.mark.parametrize("form", FORMS[1:])
def test_ply_arrays_are_native_and_outlive_the_file(tmp_path, form):
    properties = [*xyz(), *[("float", n) for n in ("nx", "ny", "nz", "radius")], *[("uchar", n) for n in "rgb"]]
    data = rows(POINTS, NORMALS, np.full((5, 1), 0.5), BYTES)
    path = put(tmp_path / "a.ply", ply(form, [("vertex", properties, data)]))
    model = load_model(path)
    with path.open("r+b") as file:
        file.write(bytes(path.stat().st_size))
    np.testing.assert_array_equal(model.points, POINTS)
    np.testing.assert_allclose(model.normals, NORMALS, atol=1e-6)
    np.testing.assert_array_equal(model.radius, np.full(5, 0.5))
    close(model.color, linear(BYTES))
    assert all(a.dtype.isnative and a.flags.c_contiguous for a in (model.points, model.normals, model.radius))


@pytest.mark.parametrize("kind", ["u1", "i1", "u2", "i2", "u4", "i4", "i8"])
@pytest.mark.parametrize("white", [255, 65535])
def test_integer_colors_are_clamped_to_black_and_white(kind, white):
    info = np.iinfo(kind)
    color = np.array(
        [v for v in (info.min, -1, 0, 1, 200, 254, 255, 256, 65535, info.max) if info.min <= v <= info.max]
    )
    expected = srgb_to_linear(np.clip(color.astype(float), 0, white) / white)
    np.testing.assert_array_equal(linear_integers(color.astype(kind), white), expected)


def test_ply_radius_makes_circles(tmp_path):
    file = ply("ascii", [("vertex", [*xyz(), ("float", "radius")], rows(POINTS, np.full((5, 1), 0.5)))])
    splats = splatcl.read(put(tmp_path / "a.ply", file))
    for tangent in (splats.tangent_u, splats.tangent_v):
        np.testing.assert_allclose(np.linalg.norm(tangent, axis=1), 0.5, rtol=1e-6)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("name", ["vertex_indices", "vertex_index"])
def test_ply_mesh_of_triangles(tmp_path, form, name):
    faces = [("list uchar int", name)]
    file = ply(form, [("vertex", xyz(), rows(POINTS)), ("face", faces, [[f] for f in FACES])])
    splats = splatcl.read(put(tmp_path / "a.ply", file))
    assert any(note.startswith("covered 3 triangles") for note in splats.notes)
    assert (splats.normal[:, 2] > 0).all()


@pytest.mark.parametrize("form", FORMS)
def test_ply_mesh_of_polygons_with_face_colors(tmp_path, form):
    properties = [("list uchar uint", "vertex_indices"), *[("uchar", n) for n in ("red", "green", "blue")]]
    faces = [[[0, 1, 3, 2], 0, 0, 255], [[1, 4, 3], 255, 0, 0], [[0, 1], 0, 255, 0]]
    file = ply(form, [("vertex", xyz(), rows(POINTS)), ("face", properties, faces)])
    splats = splatcl.read(put(tmp_path / "a.ply", file))
    assert "dropped 1 faces of fewer than 3 corners" in splats.notes
    np.testing.assert_array_equal(np.unique(splats.color, axis=0), [[0, 0, 1], [1, 0, 0]])
    red = splats.center[splats.color[:, 0] == 1]
    assert (red[:, 0] > 1).all()


@pytest.mark.parametrize("form", FORMS)
def test_ply_triangle_strips(tmp_path, form):
    strips = ("tristrips", [("list int int", "vertex_indices")], [[[0, 1, 2, 3, -1, 1, 4, 3]]])
    splats = splatcl.read(put(tmp_path / "a.ply", ply(form, [("vertex", xyz(), rows(POINTS)), strips])))
    assert any(note.startswith("covered 3 triangles") for note in splats.notes)
    assert (splats.normal[:, 2] > 0).all()  # the reader turns every other triangle of a strip


def test_ply_range_grid_is_points(tmp_path):
    scan = ("range_grid", [("list uchar int", "vertex_indices")], [[[0]], [[]], [[1]]])
    splats = splatcl.read(put(tmp_path / "a.ply", ply("binary_big_endian", [("vertex", xyz(), rows(POINTS)), scan])))
    np.testing.assert_array_equal(splats.center, POINTS)
    assert not splats.oriented


def test_gaussians_become_discs_of_the_two_longest_axes(tmp_path):
    half = np.sqrt(0.5)
    file = gaussian(
        3, x=1, y=2, z=3, f_dc_0=1, f_dc_1=0, f_dc_2=-4,
        scale_0=0, scale_1=np.log(2), scale_2=np.log(0.5), rot_0=3 * half, rot_3=3 * half,
    )  # fmt: skip
    splats = splatcl.read(put(tmp_path / "a.ply", file))
    # A quarter turn about z takes the axes x, y to y, -x; rims are at 2 sigma.
    np.testing.assert_allclose(splats.tangent_u, [[-4, 0, 0]], atol=1e-6)
    np.testing.assert_allclose(splats.tangent_v, [[0, 2, 0]], atol=1e-6)
    close(splats.color, [[0.5739225, 0.2140411, 0.0]])  # sRGB 0.5 + 0.2820948 f_dc = 0.7820948, 0.5, below 0
    assert not splats.oriented
    assert splats.notes == (
        "read Gaussians as opaque discs of 2 sigma; ignored opacity and view-dependent color (f_rest)",
    )


def test_gaussians_of_two_axes(tmp_path):
    file = gaussian(2, scale_0=np.log(3), scale_1=0, rot_0=1)
    splats = splatcl.read(put(tmp_path / "a.ply", file))
    np.testing.assert_allclose(splats.tangent_u, [[6, 0, 0]], atol=1e-6)
    np.testing.assert_allclose(splats.tangent_v, [[0, 2, 0]], atol=1e-6)
