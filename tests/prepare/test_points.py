"""Estimated splats against known surfaces: normals, no holes, little overlap, and difficult point sets."""

import numpy as np
import pytest
import tolerances as tol
from helpers.point_sets import fibonacci_sphere, grid

from splatcl.errors import InvalidSplatsError
from splatcl.prepare.points import estimate_spacing, least_eigenvectors, splats_from_points


def random_sphere(num, seed):
    v = np.random.default_rng(seed).normal(size=(num, 3))
    return v / np.linalg.norm(v, axis=1, keepdims=True)


def num_covering(splats, surface, normal):
    """Return the number of discs over each surface point, seen along the surface's normal."""
    center, u, v = (a.astype(float) for a in (splats.center, splats.tangent_u, splats.tangent_v))
    num = np.zeros(len(surface), int)
    for rows in np.array_split(np.arange(len(surface)), 1 + len(surface) * len(center) // 4_000_000):
        offset = surface[rows, None] - center
        toward = normal[rows] @ splats.normal.T
        facing = np.abs(toward) > 0.5
        along = np.einsum("pci,ci->pc", offset, splats.normal) / np.where(facing, toward, 1.0)
        hit = offset - along[..., None] * normal[rows, None]
        s = np.einsum("pci,ci->pc", hit, u) / np.einsum("ci,ci->c", u, u)
        t = np.einsum("pci,ci->pc", hit, v) / np.einsum("ci,ci->c", v, v)
        near = np.abs(along) < 0.5 * np.linalg.norm(np.ptp(center, axis=0))
        num[rows] = ((s * s + t * t <= 1) & facing & near).sum(axis=1)
    return num


def disc_areas(splats):
    return np.pi * np.linalg.norm(np.cross(splats.tangent_u, splats.tangent_v), axis=1)


def inside_grid(nx, ny, dx=1.0, dy=1.0, num=3000):
    surface = np.random.default_rng(4).uniform((1, 1, 0), (nx - 2, ny - 2, 0), (num, 3)) * (dx, dy, 1)
    return surface, np.tile((0.0, 0.0, 1.0), (num, 1))


def test_sphere_is_covered_by_discs_with_its_normals():
    points = fibonacci_sphere(4000)
    splats = splats_from_points(points)
    cos = np.abs(np.einsum("ni,ni->n", splats.normal, points))
    assert np.degrees(np.arccos(cos.min())) < tol.SPHERE_NORMAL_DEGREES
    surface = random_sphere(3000, 1)
    assert num_covering(splats, surface, surface).min() >= 1
    assert disc_areas(splats).sum() / (4 * np.pi) < tol.GRID_OVERLAP
    assert not splats.oriented


@pytest.mark.parametrize("shape", [(40, 40, 1.0, 1.0), (60, 20, 1.0, 3.0), (60, 16, 1.0, 4.0)])
def test_regular_grids_are_covered_by_ellipses_of_their_aspect(shape):
    splats = splats_from_points(grid(*shape))
    assert num_covering(splats, *inside_grid(*shape)).min() >= 1
    nx, ny, dx, dy = shape
    inner = np.arange(nx * ny).reshape(ny, nx)[4:-4, 8:-8].ravel()
    assert disc_areas(splats)[inner].mean() / (dx * dy) < tol.GRID_OVERLAP
    lengths = [np.linalg.norm(t[inner], axis=1) for t in (splats.tangent_u, splats.tangent_v)]
    np.testing.assert_allclose(np.maximum(*lengths) / np.minimum(*lengths), dy / dx, rtol=1e-3)


def test_shrunken_discs_leave_holes():
    splats = splats_from_points(grid(40, 40))
    small = type(splats)(splats.center, 0.9 * splats.tangent_u, 0.9 * splats.tangent_v)
    assert num_covering(small, *inside_grid(40, 40)).min() == 0


def test_jittered_grid_is_covered_with_bounded_overlap():
    splats = splats_from_points(grid(40, 40, jitter=0.3))
    assert num_covering(splats, *inside_grid(40, 40)).min() >= 1
    inner = np.arange(1600).reshape(40, 40)[4:-4, 4:-4].ravel()
    assert disc_areas(splats)[inner].mean() < tol.JITTERED_OVERLAP


def test_cylinder_is_covered():
    angle, height = np.meshgrid(np.arange(60) * 2 * np.pi / 60, np.arange(30) * 0.1, indexing="ij")
    points = np.stack([np.cos(angle), np.sin(angle), height], axis=-1).reshape(-1, 3)
    rng = np.random.default_rng(5)
    a, h = rng.uniform(0, 2 * np.pi, 3000), rng.uniform(0.1, 2.8, 3000)
    normal = np.stack([np.cos(a), np.sin(a), 0 * a], axis=1)
    assert num_covering(splats_from_points(points), normal + h[:, None] * (0, 0, 1), normal).min() >= 1


def test_random_points_leave_hardly_a_hole():
    splats = splats_from_points(random_sphere(4000, 6))
    surface = random_sphere(20000, 7)
    assert np.mean(num_covering(splats, surface, surface) == 0) <= tol.RANDOM_UNCOVERED
    assert disc_areas(splats).sum() / (4 * np.pi) < tol.RANDOM_OVERLAP


def test_discs_stay_near_the_boundary():
    assert splats_from_points(grid(30, 30)).radius.max() < tol.BOUNDARY_RADIUS


def test_outlier_stays_small_and_changes_nothing_far_away():
    points = grid(30, 30)
    splats = splats_from_points(np.vstack([points, [[15.0, 15.0, 200.0]]]))
    assert splats.radius[-1] < 2 * tol.BOUNDARY_RADIUS
    alone = splats_from_points(points)
    np.testing.assert_allclose(splats.radius[:-1], alone.radius, rtol=1e-5)


def test_duplicates_get_the_same_disc_and_make_no_holes():
    points = grid(30, 30)
    alone, double = splats_from_points(points), splats_from_points(np.vstack([points, points, points]))
    np.testing.assert_allclose(double.tangent_u[:900], alone.tangent_u, rtol=1e-5, atol=1e-5)
    np.testing.assert_array_equal(double.tangent_u[:900], double.tangent_u[900:1800])
    assert len(double) == 2700


def test_duplicates_keep_their_own_normals():
    points = np.repeat(grid(10, 10), 2, axis=0)
    normals = np.tile([[0.0, 0.0, 1.0], [0.0, 0.6, -0.8]], (100, 1))
    np.testing.assert_allclose(splats_from_points(points, normals).normal, normals, atol=1e-12)


@pytest.mark.parametrize("num", [1, 2, 3, 4, 5, 17])
def test_few_points_make_one_splat_each(num):
    points = np.random.default_rng(num).random((num, 3))
    splats = splats_from_points(points)
    np.testing.assert_array_equal(splats.center, points)
    assert 0 < splats.radius.max() < 5


def test_points_at_one_place():
    splats = splats_from_points(np.full((50, 3), 7.0))
    np.testing.assert_allclose(splats.radius, 1.0)


def test_points_along_a_line_touch():
    points = np.arange(50)[:, None] * (1.0, 2.0, 2.0)  # 3 apart
    splats = splats_from_points(points)
    np.testing.assert_allclose(splats.radius, 1.5 * 1.05, rtol=1e-6)
    assert np.abs(splats.normal @ (1 / 3, 2 / 3, 2 / 3)).max() < 1e-6


@pytest.mark.parametrize("seed", range(5))
def test_points_along_any_line_touch(seed):
    """Mutation: `PARALLEL` 0 in voronoi.py; the discs at both ends then grow tenfold in some directions."""
    direction = random_sphere(1, seed)
    points = np.arange(50)[:, None] * direction * 3
    splats = splats_from_points(points)
    np.testing.assert_allclose(splats.radius, 1.5 * 1.05, rtol=1e-5)
    assert np.abs(splats.normal @ direction.T).max() < 1e-6


def test_eigenvectors_are_those_of_lapack():
    """Matrices are flat, round, long, nearly degenerate and zero. Mutation: `MIN_GAP` 0 in points.py."""
    rng = np.random.default_rng(11)
    axes = np.linalg.qr(rng.normal(size=(4000, 3, 3)))[0]
    sizes = np.sort(10.0 ** -rng.uniform(0, 18, (4000, 3)), axis=1)
    sizes[::3, 1] = sizes[::3, 2]
    sizes[::5, 1] = sizes[::5, 0] + 1e-9 * sizes[::5, 2]
    sizes[:10] = 0.0
    matrices = (axes * sizes[:, None]) @ axes.transpose(0, 2, 1)
    xx, xy, xz, _, yy, yz, _, _, zz = matrices.reshape(-1, 9).T
    vectors = least_eigenvectors(np.array([xx, xy, xz, yy, yz, zz]))
    np.testing.assert_allclose(np.linalg.norm(vectors, axis=1), 1.0, rtol=1e-12)
    along = np.einsum("ni,nij,nj->n", vectors, matrices, vectors)
    assert (along - np.linalg.eigvalsh(matrices)[:, 0] <= 1e-14 * sizes[:, 2]).all()
    apart = sizes[:, 1] - sizes[:, 0] > 1e-3 * sizes[:, 2]
    tilt = np.linalg.norm(np.cross(vectors, axes[:, :, 0]), axis=1)
    assert tilt[apart].max() < 1e-10


def test_sheets_closer_than_the_spacing_are_both_covered():
    sheet = grid(30, 30, jitter=0.2)
    other = np.add(sheet, (0.05, 0.02, 0.2))
    normals = np.repeat([[0, 0, -1.0], [0, 0, 1.0]], 900, axis=0)
    splats = splats_from_points(np.vstack([sheet, other]), normals)
    assert num_covering(splats.take(slice(0, 900)), *inside_grid(30, 30)).min() >= 1


def test_survey_coordinates_cost_no_precision():
    points = grid(30, 30, jitter=0.3) / 8
    here, there = splats_from_points(points), splats_from_points(np.add(points, (637012, 849028, 431)))
    np.testing.assert_allclose(there.radius, here.radius, rtol=tol.TRANSLATED_RELATIVE)
    assert there.center.dtype == np.float64


def test_estimates_repeat_exactly_and_keep_float32():
    points = random_sphere(20000, 8).astype(np.float32)
    one, two = splats_from_points(points), splats_from_points(points)
    assert one.tangent_u.dtype == np.float32
    np.testing.assert_array_equal(one.tangent_u, two.tangent_u)
    np.testing.assert_array_equal(one.tangent_v, two.tangent_v)


def test_given_normals_orient_and_need_not_be_unit():
    points = fibonacci_sphere(500)
    splats = splats_from_points(points, -6.28 * points)
    assert splats.oriented
    np.testing.assert_allclose(splats.normal, -points, atol=1e-6)
    assert splats.notes[0].startswith("estimated radii (median ")


def test_given_radius_makes_circles_about_the_normal():
    points = fibonacci_sphere(500)
    splats = splats_from_points(points, points, radius=np.linspace(0.1, 0.2, 500))
    for tangent in (splats.tangent_u, splats.tangent_v):
        np.testing.assert_allclose(np.linalg.norm(tangent, axis=1), np.linspace(0.1, 0.2, 500))
    np.testing.assert_allclose(splats.normal, points, atol=1e-12)
    assert splats.notes == ()
    bare = splats_from_points(points, radius=0.25)
    np.testing.assert_allclose(np.linalg.norm(bare.tangent_v, axis=1), 0.25)
    assert bare.notes == ("estimated normals (PCA, 20 neighbors) for 500 points",)


def test_note_names_what_was_estimated():
    (note,) = splats_from_points(grid(20, 20)).notes
    assert note == "estimated normals (PCA, 20 neighbors) and radii (median 0.742) for 400 points"


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"points": np.nan}, "1 with a non-finite coordinate"),
        ({"points": 1e16}, "1 with a coordinate beyond 1e15"),
        ({"normals": 0.0}, "1 with a zero or non-finite normal"),
        ({"color": np.inf}, "1 with a non-finite color"),
        ({"radius": 0.0}, "1 with a radius that is not positive"),
    ],
)
def test_unusable_points_are_reported_or_dropped(change, reason):
    arrays = {"points": grid(5, 5), "normals": np.ones((25, 3)), "color": np.ones((25, 3)), "radius": np.ones(25)}
    ((name, value),) = change.items()
    arrays[name][7] = value
    with pytest.raises(InvalidSplatsError, match=f"1 of 25 points .{reason}; the first is point 7.*on_invalid"):
        splats_from_points(**arrays)
    splats = splats_from_points(**arrays, on_invalid="drop")
    assert (len(splats), splats.num_dropped) == (24, 1)
    assert reason in splats.notes[0]


@pytest.mark.parametrize(
    "arguments",
    [
        {"points": np.zeros((3, 2))},
        {"points": np.zeros((0, 3))},
        {"points": [["a", "b", "c"]]},
        {"points": np.zeros(3)},
        {"points": np.full((2, 3), np.nan), "on_invalid": "drop"},
        {"points": np.zeros((3, 3)), "normals": np.ones((2, 3))},
        {"points": np.zeros((3, 3)), "color": np.ones((3, 4))},
        {"points": np.zeros((3, 3)), "radius": np.ones((2,))},
    ],
)
def test_wrong_arrays_are_refused(arguments):
    with pytest.raises(InvalidSplatsError):
        splats_from_points(**arguments)


def test_spacing_ignores_points_at_one_place():
    assert estimate_spacing(np.repeat(grid(10, 10, 0.5, 0.5), 3, axis=0)) == 0.5
    assert estimate_spacing(np.ones((9, 3))) == estimate_spacing([[1, 2, 3]]) == 0.0


def test_spacing_of_a_sample_is_that_of_all():
    points = np.random.default_rng(10).permutation(grid(50, 50, 0.5, 0.5))
    assert estimate_spacing(points, max_samples=100) == 0.5
