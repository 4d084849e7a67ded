"""Splats of meshes: Steiner ellipses cover their triangles, and every triangle is kept."""

import numpy as np
import pytest
import tolerances as tol

from splatcl.errors import InvalidSplatsError
from splatcl.prepare import meshes
from splatcl.prepare.meshes import splats_from_mesh, steiner_ellipses

STEINER_AREA = 4 * np.pi / (3 * np.sqrt(3))
"""Area of a triangle's Steiner circumellipse, in areas of the triangle."""


def triangles(num, seed=0):
    rng = np.random.default_rng(seed)
    corners = rng.normal(size=(num, 3, 3))
    corners[: num // 4] *= (1.0, 1.0, 1e-3)  # flat triangles; below, slivers
    corners[num // 4 : num // 2, 2] = corners[num // 4 : num // 2, :2].mean(axis=1) + 1e-3
    return corners


def disc_coordinates(point, center, u, v):
    offset = point - center
    return np.stack([np.einsum("ni,ni->n", offset, t) / np.einsum("ni,ni->n", t, t) for t in (u, v)])


def triangle_areas(corners):
    edges = corners[:, 1:] - corners[:, :1]
    return 0.5 * np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)


def cube():
    x = np.array([[i >> 2 & 1, i >> 1 & 1, i & 1] for i in range(8)], float)
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    return x, np.array([[q[0], q[i], q[i + 1]] for q in quads for i in (1, 2)])


def test_corners_are_on_the_rim_of_principal_axes():
    corners = triangles(400)
    center, u, v = steiner_ellipses(corners)
    for corner in range(3):
        rim = np.hypot(*disc_coordinates(corners[:, corner], center, u, v))
        np.testing.assert_allclose(rim, 1.0, rtol=tol.RIM_RELATIVE * 1e3)
    lengths = np.linalg.norm(u, axis=1), np.linalg.norm(v, axis=1)
    assert (lengths[0] >= lengths[1]).all()
    assert np.abs(np.einsum("ni,ni->n", u, v) / (lengths[0] * lengths[1])).max() < tol.RIM_RELATIVE
    area = np.pi * np.linalg.norm(np.cross(u, v), axis=1)
    np.testing.assert_allclose(area, STEINER_AREA * triangle_areas(corners), rtol=1e-6)


def test_random_points_of_every_triangle_are_inside():
    corners = triangles(400, seed=1)
    ellipse = steiner_ellipses(corners)
    for weights in np.random.default_rng(2).dirichlet((1, 1, 1), 50):
        inside = np.hypot(*disc_coordinates(np.einsum("k,nki->ni", weights, corners), *ellipse))
        assert inside.max() <= 1


def test_normals_follow_the_winding():
    vertices, faces = cube()
    splats = splats_from_mesh(vertices, faces)
    assert (np.einsum("ni,ni->n", splats.center - 0.5, splats.normal) > 0).all()
    assert splats.oriented
    inward = splats_from_mesh(vertices, faces[:, ::-1])
    assert (np.einsum("ni,ni->n", inward.center - 0.5, inward.normal) < 0).all()


def test_vertex_normals_overrule_the_winding():
    vertices, faces = cube()
    faces[::3] = faces[::3, ::-1]
    splats = splats_from_mesh(vertices, faces, normals=vertices - 0.5)
    assert (np.einsum("ni,ni->n", splats.center - 0.5, splats.normal) > 0).all()
    assert "turned 4 triangles to the side of their vertex normals" in splats.notes


def test_large_triangles_are_halved_until_the_silhouette_is_true():
    vertices, faces = cube()
    splats = splats_from_mesh(vertices, faces)
    assert splats.radius.max() <= meshes.MAX_SIZE * np.sqrt(3)
    area = np.pi * np.linalg.norm(np.cross(splats.tangent_u, splats.tangent_v), axis=1).sum()
    np.testing.assert_allclose(area, STEINER_AREA * 6, rtol=1e-9)  # halving neither drops nor doubles a part
    assert "12 triangles" in splats.notes[-1]
    assert str(len(splats)) in splats.notes[-1]


def test_halved_faces_are_covered_and_keep_their_order():
    vertices, faces = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [3, 3, 0.0]]), np.array([[0, 1, 2], [1, 3, 2]])
    splats = splats_from_mesh(vertices, faces, max_size=0.1)
    weights = np.random.default_rng(3).dirichlet((1, 1, 1), 2000)
    for face in faces:
        offset = (weights @ vertices[face])[:, None] - splats.center
        s = [np.einsum("pci,ci->pc", offset, t) / (t * t).sum(axis=1) for t in (splats.tangent_u, splats.tangent_v)]
        assert (np.hypot(*s).min(axis=1) <= 1).all()
    first_face = splats.center[:, :2].sum(axis=1) < 1
    assert not np.diff(first_face.astype(int)).max() > 0


def test_subdivision_stops_at_the_most_splats(monkeypatch):
    monkeypatch.setattr(meshes, "MAX_SPLATS", 100)
    assert 50 < len(splats_from_mesh(*cube())) <= 100


def test_colors_of_vertices_are_averaged_and_interpolated():
    vertices, faces = np.array([[0, 0, 0], [3, 0, 0], [0, 3, 0.0]]), np.array([[0, 1, 2]])
    color = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 0.3]])
    whole = splats_from_mesh(vertices, faces, color, max_size=1)
    np.testing.assert_allclose(whole.color, [[1 / 3, 1 / 3, 0.1]], rtol=1e-6)
    halved = splats_from_mesh(vertices, faces, color)
    x, y = halved.center[:, 0] / 3, halved.center[:, 1] / 3
    np.testing.assert_allclose(halved.color, np.stack([1 - x - y, x, 0.3 * y], axis=1), atol=1e-6)


def test_colors_of_faces():
    vertices, faces = cube()
    color = np.arange(36).reshape(12, 3) / 36
    np.testing.assert_allclose(splats_from_mesh(vertices, faces, color, max_size=1).color, color, rtol=1e-6)


def test_as_many_faces_as_vertices_needs_per_face():
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    color = np.eye(4, 3)
    of_faces = splats_from_mesh(vertices, faces, color, per_face=True, max_size=1)
    np.testing.assert_allclose(of_faces.color, color)
    of_vertices = splats_from_mesh(vertices, faces, color, max_size=1)
    np.testing.assert_allclose(of_vertices.color[0], [1 / 3, 1 / 3, 1 / 3], rtol=1e-6)


def test_flat_triangles_are_skipped_and_counted():
    vertices, faces = cube()
    faces = np.vstack([faces, [[0, 0, 1], [2, 2, 2]]])
    splats = splats_from_mesh(vertices, faces)
    assert "skipped 2 of 14 triangles with no area (the first is face 12)" in splats.notes
    assert splats.num_dropped == 0
    with pytest.raises(InvalidSplatsError, match="none of 2 triangles"):
        splats_from_mesh(vertices, faces[-2:])


def test_unusable_corners_are_reported_or_dropped():
    vertices, faces = cube()
    vertices[7] = np.nan
    num = int((faces == 7).any(axis=1).sum())
    with pytest.raises(InvalidSplatsError, match=f"{num} of 12 triangles with a non-finite"):
        splats_from_mesh(vertices, faces)
    splats = splats_from_mesh(vertices, faces, on_invalid="drop", max_size=1)
    assert (len(splats), splats.num_dropped) == (12 - num, num)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"faces": np.array([[0, 1, 8]])}, "face 0 refers to vertices 0, 1, 8; indices must be 0 to 7"),
        ({"faces": np.array([[0, 1, -1]])}, "face 0 refers"),
        ({"faces": np.array([[0.0, 1, 2]])}, "faces are float64"),
        ({"faces": np.array([[0, 1, 2, 3]])}, "shape"),
        ({"vertices": np.zeros((8, 2))}, "vertices have shape"),
        ({"color": np.zeros((5, 3))}, "color has shape"),
        ({"normals": np.zeros((5, 3))}, "normals have shape"),
    ],
)
def test_wrong_arrays_are_refused(change, message):
    vertices, faces = cube()
    with pytest.raises(InvalidSplatsError, match=message):
        splats_from_mesh(**{"vertices": vertices, "faces": faces, **change})


def test_float32_vertices_give_float32_splats():
    vertices, faces = cube()
    splats = splats_from_mesh(vertices.astype(np.float32), faces)
    assert {a.dtype for a in (splats.center, splats.tangent_u, splats.tangent_v)} == {np.dtype(np.float32)}
