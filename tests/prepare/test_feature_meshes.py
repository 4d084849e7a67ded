"""Sharp features of meshes and of solids: every face stays covered, and no splat reaches over an edge."""

import numpy as np
import pytest
import tolerances as tol
from helpers.feature_rays import kept, kept_places
from helpers.paths import ROOT
from scipy.spatial import cKDTree

import splatcl
from splatcl.cli import MISTAKE, main
from splatcl.errors import InvalidSplatsError, SettingsError
from splatcl.features import Solid, box, csg_splats, cylinder, mesh_features, sphere
from splatcl.prepare.meshes import splats_from_mesh

FANDISK = ROOT.parent / "shared" / "data" / "fandisk.off"


def turn(p, q, r):
    """Return twice the area of a triangle in the plane, positive if counterclockwise."""
    return (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])


def ears(outline):
    """Return the triangles of a counterclockwise outline, cut off ear by ear."""
    left, triangles = list(range(len(outline))), []
    while len(left) > 2:
        for k in range(len(left)):
            ear = [left[(k + i) % len(left)] for i in range(3)]
            a, b, c = outline[ear]
            others = [outline[i] for i in left if i not in ear]
            if turn(a, b, c) > 0 and not any(min(turn(a, b, o), turn(b, c, o), turn(c, a, o)) >= 0 for o in others):
                triangles.append(ear)
                left.remove(ear[1])
                break
    return np.array(triangles)


def prism(outline):
    """Return vertices and faces of the prism over a counterclockwise outline, from z = 0 to 1."""
    num, i = len(outline), np.arange(len(outline))
    top, j = ears(outline) + num, (i + 1) % num
    sides = np.concatenate([np.stack([i, j, i + num], axis=1), np.stack([j, j + num, i + num], axis=1)])
    vertices = np.concatenate([np.insert(outline, 2, z, axis=1) for z in (0.0, 1.0)])
    return vertices, np.concatenate([top[:, ::-1] - num, top, sides])


STAR = np.array([(np.cos(t), np.sin(t)) for t in np.arange(10) * np.pi / 5]) * np.tile((1.0, 0.4), 5)[:, None]
MESHES = {
    "tetrahedron": (np.array([(0, 0, 0), (1, 0, 0), (0.3, 1.1, 0), (0.2, 0.4, 0.9)]),
                    np.array([(0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3)])),
    "triangle": (np.array([(0, 0, 0), (3, 0.5, 1), (1, 2, 0.2)]), np.array([(0, 1, 2)])),
    "notch": prism(np.array([(0, 0), (3, 0), (3, 1), (1, 1), (1, 2.5), (0, 2.5)], float)),
    "star": prism(STAR),
    "polygon": prism(np.array([(np.cos(t), np.sin(t)) for t in np.arange(24) * np.pi / 12])),
}  # fmt: skip


def places_of(vertices, faces, num, seed=0):
    """Return (F num, 3) random points of the triangles, some of them on edges."""
    share = np.random.default_rng(seed).dirichlet((0.4, 0.4, 0.4), (len(faces), num))
    share[:, ::5, 2] = 0
    share /= share.sum(axis=2, keepdims=True)
    return np.einsum("fnk,fkd->fnd", share, vertices[faces]).reshape(-1, 3)


def is_kept(splats, points, flat):
    """Return whether each point is kept by a splat with its plane nearer than `flat`, up to rounding."""
    near = cKDTree(splats.center).query_ball_point(points, splats.radius.max() * (1 + 1e-9))
    point = np.repeat(np.arange(len(points)), [len(n) for n in near])
    ids = np.concatenate([np.array(n, int) for n in near])
    close = np.abs(((points[point] - splats.center[ids]) * splats.normal[ids]).sum(axis=1)) <= flat
    point, ids = point[close], ids[close]
    center = splats.center[ids]
    shrunk = center + (points[point] - center) * (1 - tol.FEATURE)  # corners lie on rims
    found = np.zeros(len(points), bool)
    found[point[kept(splats, ids, shrunk, tol.FEATURE)]] = True
    return found


def on_faces(vertices, faces, points):
    """Return whether points are on any triangle, to within FEATURE_SPILL."""
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    found = np.zeros(len(points), bool)
    for k in range(len(faces)):
        away = [np.abs((points - a[k]) @ normal[k])]
        for p, q in ((a, b), (b, c), (c, a)):
            edge = q[k] - p[k]
            away.append((points - p[k]) @ np.cross(edge, normal[k]) / np.linalg.norm(edge))
        found |= np.max(away, axis=0) <= tol.FEATURE_SPILL
    return found


@pytest.mark.parametrize("max_size", [1.0, 0.1])
@pytest.mark.parametrize("name", MESHES)
def test_flat_faces_are_covered_exactly(name, max_size):
    vertices, faces = MESHES[name]
    angle = 10.0 if name == "polygon" else 30.0
    splats = mesh_features(vertices, faces, angle=angle, max_size=max_size)
    assert not any("still" in note for note in splats.notes)
    assert is_kept(splats, places_of(vertices, faces, 60), tol.FEATURE).all()
    assert on_faces(vertices, faces, kept_places(splats, 40)[0]).all()
    # Without clip lines the splats jut out.
    bare = splatcl.Splats(splats.center, splats.tangent_u, splats.tangent_v, clip=np.zeros((len(splats), 2, 3)))
    assert not on_faces(vertices, faces, kept_places(bare, 40)[0]).all()


def test_a_triangle_of_three_sharp_edges_becomes_four_splats():
    splats = mesh_features(*MESHES["tetrahedron"], max_size=1)
    assert len(splats) == 16
    assert splats.notes == (
        "covered 4 triangles by their Steiner ellipses",
        "cut 12 of 16 splats off at 6 edges sharper than 30 degrees",
        "split 4 triangles into four at sharp edges",
    )
    # A cube's triangles have two sharp edges each, at a right angle, so twelve splats suffice.
    square = prism(np.array([(0, 0), (1, 0), (1, 1), (0, 1)], float))
    assert len(mesh_features(*square, max_size=1)) == 12


def test_smooth_meshes_are_left_alone_and_colors_are_kept():
    trimesh = pytest.importorskip("trimesh")
    ball = trimesh.creation.icosphere(3)
    color = np.random.default_rng(0).random(ball.vertices.shape)
    plain, splats = (make(ball.vertices, ball.faces, color) for make in (splats_from_mesh, mesh_features))
    assert splats.notes[-1] == f"cut 0 of {len(plain)} splats off at 0 edges sharper than 30 degrees"
    for name in ("center", "tangent_u", "tangent_v", "color"):
        np.testing.assert_array_equal(getattr(splats, name), getattr(plain, name))
    flat = mesh_features(ball.vertices, ball.faces, color, angle=0.1, max_size=1)
    assert len(flat) == 4 * len(ball.faces) and 0 < flat.color.min() < flat.color.max() < 1


def test_winding_and_doubled_vertices_do_not_matter():
    vertices, faces = MESHES["notch"]
    wanted = mesh_features(vertices, faces)
    apart = mesh_features(vertices[faces].reshape(-1, 3), np.arange(faces.size).reshape(-1, 3))
    np.testing.assert_array_equal(apart.clip, wanted.clip)
    turned = np.where(np.arange(len(faces))[:, None] % 2, faces, faces[:, ::-1])
    some = mesh_features(vertices, turned)
    assert some.notes[-1].endswith("at 18 edges sharper than 30 degrees")
    assert is_kept(some, places_of(vertices, faces, 40), tol.FEATURE).all()


@pytest.mark.parametrize("angle", [-1, 181, np.nan])
def test_angles_out_of_range(angle):
    with pytest.raises(SettingsError, match="must be between 0 and 180 degrees"):
        mesh_features(*MESHES["notch"], angle=angle)


@pytest.mark.skipif(not FANDISK.exists(), reason="the shared files are not here")
def test_fandisk():
    from splatcl.io.read import load_model

    model = load_model(FANDISK)
    splats = mesh_features(model.points, model.faces)
    assert "cut 3" in splats.notes[1] and "at 722 edges sharper than 30 degrees" in splats.notes[1]
    assert len(splats) < 1.02 * len(splats_from_mesh(model.points, model.faces))
    assert is_kept(splats, places_of(model.points, model.faces, 4), tol.FEATURE).all()


def test_a_box_less_a_ball_ends_at_its_edges():
    spacing, radius, corner = 0.05, 0.5, np.array((0.5, 0.5, 0.5))
    splats = csg_splats(box((0, 0, 0), (1, 1, 1)) - sphere(corner, radius, (1, 0, 0)), spacing)
    inner = splats.color[:, 1] == 0
    assert len(splats) > 1500 and 100 < inner.sum() < len(splats) / 2
    # Normals point out of the solid, so those on the ball's surface point toward its center.
    assert (((corner - splats.center) * splats.normal).sum(axis=1)[inner] > 0.9 * radius).all()
    sag = spacing**2 / (2 * radius)  # above that of a disc, 1.05 sqrt(1/2) spacings in radius, or of its chord
    flat = kept_places(splats.take(~inner), 40)[0]
    assert np.abs(flat).max() < 0.5 + tol.FEATURE_SPILL
    assert np.linalg.norm(flat - corner, axis=1).min() > radius - sag
    hollow = kept_places(splats.take(inner), 40)[0]
    assert hollow.max() < 0.5 + tol.FEATURE_SPILL
    # The flat parts of the faces are covered up to the rim of the hollow.
    rng = np.random.default_rng(0)
    angle = rng.uniform(np.pi, 1.5 * np.pi, 4000)
    rim = radius + np.where(rng.random(4000) < 0.5, 1e-6, 0.3 * rng.random(4000))
    for axis in range(3):
        points = np.insert(0.5 + rim[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1), axis, 0.5, axis=1)
        assert is_kept(splats, points, tol.FEATURE).all()
    # The hollow is covered too.
    way = -np.abs(rng.normal(size=(4000, 3)))
    points = corner + radius * way / np.linalg.norm(way, axis=1, keepdims=True)
    assert is_kept(splats, points, sag).all()


def test_splats_of_a_solid_lie_between_inside_and_outside():
    pole, ball = cylinder((0, -0.6, 0), (0, 0.6, 0.1), 0.3), sphere((0.1, 0, 0), 0.45)
    solid = (pole | (box((0, 0, 0), (1, 0.5, 0.5)) & ball)) - box((0.4, 0.2, 0.2), (0.4, 0.3, 0.3))
    splats = csg_splats(solid, 0.04)
    assert 2000 < len(splats) < 4000 and splats.notes[0].startswith(f"covered 16 surfaces with {len(splats)} splats")
    places, ids = kept_places(splats, 20)
    step = 4e-3  # above the sag of the discs, 1.5e-3
    beyond = splats.normal[ids] * step
    distances = np.stack([np.abs(surface.nearest(places)[0]) for surface in solid.surfaces])
    clear = np.sort(distances, axis=0)[1] > 3 * step  # far from all surfaces but the splat's own
    assert clear.mean() > 0.6
    assert solid.inside(places - beyond)[clear].all() and not solid.inside(places + beyond)[clear].any()


def test_a_part_that_is_not_convex_takes_two_splats():
    # A pocket's corner lies in one large splat; the part outside of both walls is an L.
    solid = box((0, 0, -1), (2, 2, 2)) - box((0.5, 0.5, 0), (0.8, 0.8, 0.5))
    splats = csg_splats(solid, 2.0)
    top = np.flatnonzero((splats.center == 0).all(axis=1))
    assert len(top) >= 2
    grid = np.linspace(-0.7, 0.09, 20)
    level = np.insert(np.stack(np.meshgrid(grid, grid), axis=-1).reshape(-1, 2), 2, 0.0, axis=1)
    assert is_kept(splats.take(top), level, tol.FEATURE).all()
    pocket = level + np.array((0.85, 0.85, 0))
    inner = (pocket[:, :2] > 0.1 + 1e-9).all(axis=1) & (pocket[:, :2] < 0.9 - 1e-9).all(axis=1)
    assert not is_kept(splats.take(top), pocket[inner], tol.FEATURE).any()


def test_solids_that_make_no_sense():
    for bad in (lambda: sphere((0, 0, 0), 0), lambda: box((0, 0, 0), (1, -1, 1)), lambda: box((0, 0), (1, 1, 1)),
                lambda: cylinder((0, 0, 0), (0, 0, 0), 1), lambda: csg_splats(sphere((0, 0, 0), 1), 0)):  # fmt: skip
        with pytest.raises(SettingsError, match=r"must be positive and finite|must be three finite numbers"):
            bad()
    nothing = csg_splats(sphere((0, 0, 0), 1) & sphere((5, 0, 0), 1), 0.5)
    assert isinstance(sphere((0, 0, 0), 1), Solid) and len(nothing) == 0


def test_the_command_writes_splats_that_are_read_back(tmp_path, capsys):
    vertices, faces = MESHES["tetrahedron"]
    mesh = tmp_path / "mesh.off"
    rows = [" ".join(map(str, v)) for v in vertices] + [f"3 {' '.join(map(str, f))}" for f in faces]
    mesh.write_text("\n".join(["OFF", f"{len(vertices)} {len(faces)} 0", *rows, ""]))
    wanted = mesh_features(vertices, faces)
    for name in ("out.npz", "out.ply"):
        assert main(["features", str(mesh), "-o", str(tmp_path / name), "--angle", "30"]) == 0
        out = capsys.readouterr().out.splitlines()
        assert f"{name} ({len(wanted)} splats, " in out[-1] and out[0].startswith("note: covered 4 triangles")
        np.testing.assert_array_equal(splatcl.read(tmp_path / name).clip, wanted.clip)
    points = tmp_path / "points.xyz"
    points.write_text("0 0 0\n1 0 0\n0 1 0\n")
    for arguments, message in [
        ([str(points), "-o", "a.ply"], f"{points}: has no triangles; give a mesh"),
        ([str(mesh), "-o", "a.off"], "a.off: cannot write .off; use .ply or .npz"),
        ([str(mesh), "-o", "a.ply", "--angle", "200"], "--angle 200.0 must be between 0 and 180 degrees"),
    ]:
        assert main(["features", *arguments]) == MISTAKE
        assert capsys.readouterr().err == f"splatcl: error: {message}\n"


def test_a_mesh_of_no_area_is_an_error():
    with pytest.raises(InvalidSplatsError, match="none of 1 triangles"):
        mesh_features(np.zeros((3, 3)), np.array([(0, 1, 2)]))
