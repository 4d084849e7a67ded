"""The oracle's fragments against closed forms and against a linear solver that shares no code with it."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from helpers.oracle_cases import (
    NONE,
    PROJECTIONS,
    UNIT,
    camera,
    discs,
    facing_disc,
    random_rotation,
    random_splats,
    rays,
    render,
    solve,
)
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from tolerances import (
    AREA_PER_PERIMETER,
    ORACLE_RELATIVE,
)

from splatcl import Camera, RenderSettings, oracle
from splatcl.oracle.project import project

# ---- footprint


@pytest.mark.parametrize("projection", PROJECTIONS)
@pytest.mark.parametrize("radii", [(1.0, 1.0), (1.2, 0.4)])
def test_facing_disc_covers_its_area_in_pixels(projection, radii):
    scale = 50.0  # pixels per scene unit at z = 3
    view = camera(160, 150.0 if projection == "perspective" else 50.0, cx=79.3, projection=projection)
    image = render(discs(((0.1, 0, 3), (0, radii[1], 0), (radii[0], 0, 0))), view)
    a, b = scale * radii[0], scale * radii[1]
    perimeter = math.pi * (3 * (a + b) - math.sqrt((3 * a + b) * (a + 3 * b)))
    count = np.count_nonzero(image["color"][..., 3])
    assert abs(count - math.pi * a * b) < AREA_PER_PERIMETER * perimeter
    y, x = np.nonzero(image["color"][..., 3])
    center = 0.1 * scale + 79.3
    assert_allclose([x.mean() + 0.5, y.mean() + 0.5], [center, 80.0], atol=AREA_PER_PERIMETER)


@pytest.mark.parametrize("projection", PROJECTIONS)
def test_depth_and_position_of_a_tilted_plane(projection):
    normal, height = np.array([0.3, -0.5, -1.0]), -2.0  # n.p = height
    t_u = np.cross(normal, [1.0, 0, 0])
    t_v = np.cross(normal, t_u)
    view = camera(24, 30.0, cx=13.25, fy=21.0, projection=projection)
    image = render(discs((np.array([0, 0, 2.0]), 9 * t_u, 9 * t_v)), view)
    s = rays(view)
    if projection == "perspective":
        z = height / (s @ normal[:2] + normal[2])
        length = np.sqrt(1 + (s**2).sum(axis=-1))
        xy = s * z[..., None]
    else:
        z, length, xy = (height - s @ normal[:2]) / normal[2], 1.0, s
    assert_allclose(image["Z"], z, rtol=ORACLE_RELATIVE)
    assert_allclose(image["depth.mean"], z, rtol=ORACLE_RELATIVE)
    assert_allclose(image["depth.distance"], z * length, rtol=ORACLE_RELATIVE)
    assert_allclose(image["P"], np.concatenate([xy, z[..., None]], -1), rtol=ORACLE_RELATIVE)
    assert_allclose(image["N"], np.broadcast_to(normal / np.linalg.norm(normal), image["N"].shape))
    assert_array_equal(image["particleid"], 0)


@pytest.mark.parametrize("projection", PROJECTIONS)
@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_any_disc_agrees_with_a_linear_solve(projection, seed):
    rng = np.random.default_rng(seed)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = random_rotation(rng), rng.normal(size=3)
    f = rng.uniform(10, 40, 2) * (1.0 if projection == "perspective" else 0.3)
    view = Camera(pose, *f, *rng.uniform(-5, 25, 2), 21, 17, near=0.6, far=2.5, projection=projection)
    eye = random_splats(rng, 1, size=1.0, z=(-0.3, 3.0))
    inverse = pose[:3, :3].T
    center, t_u, t_v = inverse @ (eye.center[0] - pose[:3, 3]), inverse @ eye.tangent_u[0], inverse @ eye.tangent_v[0]
    image = render(discs((center, t_u, t_v)), view)
    u, v, z = np.moveaxis(solve(view, center, t_u, t_v), -1, 0)
    r_squared = u**2 + v**2
    hit = (r_squared <= 1) & (z >= view.near) & (z <= view.far)
    firm = image["margin"] > 1e-6 / UNIT
    assert_array_equal(np.isfinite(image["Z"])[firm], hit[firm])
    both = hit & firm
    assert_allclose(image["Z"][both], z[both], rtol=1e-9)
    assert_allclose(image["weight"], np.where(np.isfinite(image["Z"]), np.exp(-2 * r_squared), 0), rtol=1e-9)


@pytest.mark.parametrize("z", [0.5, 0.0, -0.5])
def test_ground_disc_through_the_eye_plane_shows_its_visible_part(z):
    """A disc of radius 2 in the plane y = 1 shows its part in front of the near plane."""
    view = camera(64, 32.0, near=0.75, far=1.5)
    image = render(discs(((0, 1, z), (0, 0, 2), (2, 0, 0))), view)
    s = rays(view)
    with np.errstate(divide="ignore"):
        depth = 1 / s[..., 1]
    hit = (depth >= 0.75) & (depth <= 1.5) & ((s[..., 0] * depth) ** 2 + (depth - z) ** 2 <= 4)
    assert 100 < np.count_nonzero(hit) < hit.size / 2
    assert_array_equal(np.isfinite(image["Z"]), hit)
    assert_allclose(image["Z"][hit], depth[hit], rtol=ORACLE_RELATIVE)
    bounds = project(discs(((0, 1, z), (0, 0, 2), (2, 0, 0))), view, RenderSettings()).bounds
    assert_array_equal(np.isinf(bounds), True)


@pytest.mark.parametrize("distance", [0.99, 1.0, 1.5, 2.0, 2.01])
def test_near_and_far_are_inclusive(distance):
    image = render(discs(facing_disc(distance)), camera(9, near=1.0, far=2.0), prefilter="min")
    visible = 1.0 <= distance <= 2.0
    assert_array_equal(image["count"] > 0, visible)


def test_orthographic_near_may_be_negative():
    view = camera(9, 4.0, projection="orthographic", near=-3.0)
    image = render(discs(facing_disc(-2.0, 9.0), facing_disc(-4.0, 9.0)), view)
    assert_array_equal(image["Z"], -2.0)
    assert_array_equal(image["depth.distance"], -2.0)


def test_principal_point_moves_the_image():
    splats = random_splats(np.random.default_rng(5), 40)
    whole = render(splats, camera(32), prefilter="min")
    part = render(splats, camera(32, cx=16 - 7, cy=16 - 3, width=20, height=11), prefilter="min")
    for name, image in whole.items():
        assert_allclose(part[name], image[3:14, 7:27], rtol=1e-9, atol=1e-9 if name != "margin" else 1e3)


# ---- edge-on


@pytest.mark.parametrize("projection", PROJECTIONS)
@pytest.mark.parametrize("angle", [0.0, 2.0**-16 * 0.99, 2.0**-16 * 1.01, 0.01])
@pytest.mark.parametrize("sign", [-1, 1])
def test_edge_on_disc_is_left_to_the_prefilter(projection, angle, sign):
    """The middle pixel's ray passes through the center, so it hits unless the disc counts as edge-on."""
    row = (0, 0, 2), (0, 1, 0), (math.sin(sign * angle), 0, math.cos(angle))
    view = camera(9, 4.0, projection=projection)
    edge_on = angle < 2.0**-16
    alone = render(discs(row), view)
    assert np.count_nonzero(alone["count"]) == (0 if edge_on else alone["count"].sum())
    assert np.isinf(alone["Z"][4, 4]) == edge_on
    filtered = render(discs(row), view, prefilter="min")
    assert filtered["count"][4, 4] == 1
    assert filtered["weight"][4, 4] == 1.0
    assert filtered["depth.mean"][4, 4] == 2.0
    assert np.isinf(filtered["Z"][4, 4]) == edge_on
    assert filtered["particleid"][4, 4] == (NONE if edge_on else 0)


# ---- weights


@pytest.mark.parametrize("cutoff", [0.0, 1.0, 2.0, 3.5])
def test_weight_falls_from_one_to_the_rim(cutoff):
    """A radius of 4 pixels about a pixel center gives r = 0, 1/4 ... 1 along the row, the rim included."""
    image = render(discs(facing_disc(2.0, 0.25)), camera(), cutoff=cutoff)
    expected = [math.exp(-((cutoff * k / 4) ** 2) / 2) for k in range(5)]
    assert image["weight"][16, 16] == 1.0
    assert_allclose(image["weight"][16, 16:21], expected, rtol=ORACLE_RELATIVE)
    assert_allclose(image["weight"][16:21, 16], expected, rtol=ORACLE_RELATIVE)
    assert image["weight"][16, 21] == 0 == image["weight"][21, 16]
    assert_array_equal(image["Z"][16, 16:22], [2, 2, 2, 2, 2, np.inf])
    if cutoff == 2:
        assert image["weight"][16, 20] == pytest.approx(math.exp(-2))


@pytest.mark.parametrize(
    ("kernel", "expected"),
    [
        ({"kernel": "constant"}, [1, 1, 1, 1, 1, 0]),
        # r = 0, 1/4, 1/2, 3/4, 1 is at 0, 1/2, 1, 3/2, 2 of the three samples
        ({"kernel": "table", "kernel_table": (8, 4, 1)}, [8, 4, 4, 1, 1, 0]),
        ({"kernel": "table", "kernel_table": (8, 4, 1), "kernel_lookup": "linear"}, [8, 6, 4, 2.5, 1, 0]),
        # r^2 = 0, 1/16, 1/4, 9/16, 1: positions 0, 1/8, 1/2, 9/8, 2
        ({"kernel": "table", "kernel_table": (8, 4, 1), "table_over": "r2"}, [8, 8, 4, 4, 1, 0]),
        # three texels: positions 0, 1/4, 1, 7/4, 2, the first and the last clamped
        (
            {"kernel": "table", "kernel_table": (8, 4, 1), "kernel_lookup": "linear", "table_addressing": "texture"},
            [8, 7, 4, 1.75, 1, 0],
        ),
        # four texels: floor(4 r), and 3 at the rim
        ({"kernel": "table", "kernel_table": (8, 4, 2, 1), "table_addressing": "texture"}, [8, 4, 2, 1, 1, 0]),
        # four texels over r^2: floor(0, 1/4, 1, 9/4, 4)
        (
            {
                "kernel": "table",
                "kernel_table": (8, 4, 2, 1),
                "table_addressing": "texture",
                "table_over": "r2",
            },
            [8, 8, 4, 2, 1, 0],
        ),
    ],
)
def test_kernels(kernel, expected):
    image = render(discs(facing_disc(2.0, 0.25)), camera(), **kernel)
    assert_array_equal(image["weight"][16, 16:22], expected)


@pytest.mark.parametrize(("gap", "epsilon", "inclusive", "strict"), [(0, 0, 2, 0), (0.5, 0.5, 2, 1), (0.5, 0.75, 2, 2)])
def test_the_epsilon_test_at_its_limit(gap, epsilon, inclusive, strict):
    """Two discs one `gap` behind the other: the limit itself is inside the inclusive test alone."""
    splats = discs(facing_disc(2.0, 0.25), facing_disc(2.0 + gap, 0.5))
    counts = [
        render(splats, camera(), epsilon=epsilon, epsilon_test=test)["count"][16, 16]
        for test in ("inclusive", "strict")
    ]
    assert counts == [inclusive, strict]


def test_a_strict_epsilon_of_zero_draws_no_disc():
    image = render(discs(facing_disc(2.0, 0.25)), camera(), epsilon=0.0, epsilon_test="strict")
    assert image["Z"][16, 16] == 2.0 and image["particleid"][16, 16] == 0
    assert not image["count"].any() and not image["color"].any()
    assert image["margin"][16, 16] > 1e3  # rounding cannot draw it


def test_the_margin_of_a_strict_epsilon_is_that_of_its_sum():
    """z + epsilon exceeds z by four units of 2^-24 z."""
    image = render(discs(facing_disc(2.0, 0.25)), camera(), epsilon=8 * UNIT, epsilon_test="strict")
    assert image["count"][16, 16] == 1
    assert image["margin"][16, 16] == pytest.approx(4, rel=1e-6)


def test_zero_weight_is_counted_but_not_covered():
    image = render(discs(facing_disc(2.0, 0.25)), camera(), kernel="table", kernel_table=(0, 0))
    assert image["count"][16, 16] == 1
    assert image["Z"][16, 16] == 2.0
    assert_array_equal(image["color"], 0)
    assert_array_equal(image["P"], 0)
    assert_array_equal(image["depth.mean"], np.inf)


# ---- pre-filter


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_the_depth_of_fragments_of_the_prefilter_alone(projection):
    """A tiny disc at a pixel's corner, tilted by 45 degrees about y: its plane is z = 2 + x."""
    view = camera(32, projection=projection)
    tiny = discs(((0, 0, 2.0), (1e-4, 0, 1e-4), (0, 1e-4, 0)))
    s = rays(view)[15, 15:17, 0]
    plane = 2 + s if projection == "orthographic" else 2 / (1 - s)
    means = {
        depth: render(tiny, view, prefilter="min", filter_depth=depth)["depth.mean"][15, 15:17]
        for depth in ("center", "plane", "front")
    }
    assert_allclose(means["plane"], plane, rtol=ORACLE_RELATIVE)
    assert_allclose(means["center"], 2, rtol=ORACLE_RELATIVE)
    assert_array_equal(means["front"], means["center"])  # no disc is hit


def test_a_filtered_fragment_at_the_front_layer_passes_the_epsilon_test():
    """A tiny disc one unit behind a large one: the center's depth hides it, depth(p) does not."""
    view = camera(32)
    pair = discs(facing_disc(2.0, 1.0), facing_disc(3.0, 1e-4))
    counts = {
        (depth, test): render(pair, view, prefilter="min", filter_depth=depth, epsilon=0.0, epsilon_test=test)
        for depth, test in (("center", "inclusive"), ("front", "inclusive"), ("front", "strict"))
    }
    assert [image["count"][15, 15] for image in counts.values()] == [1, 2, 0]
    assert counts["front", "inclusive"]["depth.mean"][15, 15] == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("u", "v"),
    [
        ((0, 0, 1e-4), (0, 1e-4, 0)),  # edge-on
        ((2e-5, 0, 1e-2), (0, 1e-4, 0)),  # nearly so: the plane z = 2 + 500 x is behind the eye at x > 0
    ],
)
def test_a_plane_without_a_depth_leaves_the_center_s(u, v):
    view = camera(32)
    image = render(discs(((0, 0, 2.0), u, v)), view, prefilter="min", filter_depth="plane")
    covered = image["count"][15:17, 15:17] > 0
    assert covered.all() and np.isfinite(image["depth.mean"][15:17, 15:17]).all()
    assert_allclose(image["depth.mean"][15:17, 16], 2.0, rtol=ORACLE_RELATIVE)


@pytest.mark.parametrize(("radius", "num", "squares"), [(1.0, 4, (0.5,)), (2.0, 12, (0.5, 2.5))])
def test_sub_pixel_splat_lives_by_its_prefilter(radius, num, squares):
    """A tiny splat projects onto a corner of pixels, with centers sqrt(1/2), sqrt(5/2) ... away."""
    view = camera(32)
    tiny = discs(facing_disc(2.0, 1e-4))
    assert not render(tiny, view)["count"].any()
    image = render(tiny, view, prefilter="min", prefilter_radius=radius)
    assert image["count"].sum() == num
    weights = np.unique(image["weight"][image["count"] > 0].round(12))
    assert_allclose(weights, sorted(math.exp(-2 * s / radius**2) for s in squares), rtol=1e-10)
    assert_array_equal(image["Z"], np.inf)
    assert_array_equal(image["particleid"], NONE)
    covered = image["count"] > 0
    assert_array_equal(image["color"][..., 3], covered)
    assert_array_equal(image["depth.mean"], np.where(covered, 2.0, np.inf))
    distance = 2 * np.sqrt(1 + (rays(view) ** 2).sum(axis=-1))
    assert_allclose(image["depth.distance"], np.where(covered, distance, np.inf), rtol=ORACLE_RELATIVE)
    assert_allclose(image["P"][..., :2], 2 * rays(view) * covered[..., None], rtol=ORACLE_RELATIVE)


def test_prefilter_takes_the_nearer_of_both_distances():
    """A slit 8 pixels long and 1/2 wide has r = min(|dx| / 4, |(dx, dy)|) on its row, |(dx, dy)| off it."""
    image = render(discs(((0, 0, 2), (0, 1 / 64, 0), (0.25, 0, 0))), camera(), prefilter="min")
    assert_allclose(image["weight"][16, 16:22], [math.exp(-(k**2) / 8) for k in range(5)] + [0])
    assert_allclose(image["weight"][17, 16:19], [math.exp(-2), 0, 0])
    assert_array_equal(np.isfinite(image["Z"][15:18, 16]), [False, True, False])
    assert image["weight"][17, 16] == pytest.approx(math.exp(-2))


def test_prefilter_fragment_lies_at_its_center_and_obeys_the_depth_test():
    """A tiny splat 0.1 behind or in front of a wall is visible within epsilon, and never in the depth buffer."""
    view = camera(32)
    for z, epsilon, count in [(2.1, 0.2, 2), (2.1, 0.05, 1), (1.9, 0.0, 2)]:
        splats = discs(facing_disc(2.0, 3.0), facing_disc(z, 1e-4))
        image = render(splats, view, prefilter="min", epsilon=epsilon)
        assert image["count"][16, 16] == count
        assert_array_equal(image["Z"], 2.0)
        assert_array_equal(image["particleid"], 0)
        wall, tiny = np.exp(-2 * (rays(view)[16, 16] ** 2).sum() * 4 / 9), math.exp(-1) * (count == 2)
        mean = (wall * 2.0 + tiny * z) / (wall + tiny)
        assert image["depth.mean"][16, 16] == pytest.approx(mean, rel=1e-10)


def test_prefilter_needs_a_center_in_range():
    for z, visible in [(0.9, False), (1.0, True), (3.0, True), (3.1, False), (-1.0, False)]:
        image = render(discs(facing_disc(z, 1e-4)), camera(32, near=1.0, far=3.0), prefilter="min")
        assert image["count"].any() == visible


def test_prefilter_about_the_projected_bounds():
    """A disc is turned by 60 degrees about y; its left and right edges are at u = -1 and 1."""
    cosine, sine, radius, f = 0.5, math.sqrt(3) / 2, 1.0, 32.0
    row = (0, 0, 2), (0, radius, 0), (radius * cosine, 0, radius * sine)
    edges = [f * u * cosine / (2 + u * sine) + 16.5 for u in (-1, 1)]
    for choice, x in [("projected", 16.5), ("bounds", sum(edges) / 2)]:
        chosen = RenderSettings(prefilter_center=choice)
        projected = project(discs(row), camera(), chosen)
        assert_allclose(projected.prefilter_center, [[x, 16.5]], rtol=ORACLE_RELATIVE)
        assert_allclose(projected.center_raster, [[16.5, 16.5]], rtol=ORACLE_RELATIVE)
        assert_allclose(projected.bounds[0, [0, 2]], edges, rtol=ORACLE_RELATIVE)
    # The two centers differ by the perspective of the disc alone, so a large disc shows the difference.
    image = oracle.render(discs(row), camera(), RenderSettings(prefilter_center="bounds", prefilter_radius=6.0))
    pixel = 16.5 + rays(camera())[16, :, 0] * f
    r2 = (pixel - sum(edges) / 2) ** 2 / 36
    slope = rays(camera())[16, :, 0]
    z = 2 / (1 - slope * sine / cosine)
    r3 = np.where(z > 0, (slope * z / cosine) ** 2, np.inf)
    r = np.minimum(np.where(r3 <= 1, r3, np.inf), r2)
    assert_allclose(image["weight"][16], np.where(r <= 1, np.exp(-2 * r), 0), rtol=1e-9)


def test_prefilter_about_infinite_bounds_is_absent():
    splats = discs(((0, 1, 0.5), (0, 0, 2), (2, 0, 0)))
    projected = project(splats, camera(), RenderSettings(prefilter_center="bounds"))
    assert np.isnan(projected.prefilter_center).all()
    assert np.isfinite(project(splats, camera(), RenderSettings()).prefilter_center).all()


def test_prefilter_about_the_projected_parallelogram():
    """Tangents turned by 45 degrees in their plane: the disc stays, its corners are sqrt(2) along the first ones."""
    cosine, sine, f, far = 0.5, math.sqrt(3) / 2, 32.0, math.sqrt(2)
    first, second = np.array([0.0, 1.0, 0.0]), np.array([cosine, 0.0, sine])
    row = (0, 0, 2), (first + second) / far, (second - first) / far
    corners = [f * u * cosine / (2 + u * sine) + 16.5 for u in (-far, far)]
    chosen = RenderSettings(prefilter_center="parallelogram")
    projected = project(discs(row), camera(), chosen)
    assert_allclose(projected.prefilter_center, [[sum(corners) / 2, 16.5]], rtol=ORACLE_RELATIVE)
    flat = project(discs(row), camera(projection="orthographic"), chosen)
    assert_allclose(flat.prefilter_center, flat.center_raster, rtol=ORACLE_RELATIVE)


def test_prefilter_about_an_infinite_parallelogram_is_absent():
    """A disc clear of the eye plane whose corner is not: it has bounds, but its parallelogram has none."""
    splats = discs(((0, 1, 1.8), (0, 0.4, 1), (0.7, 0, 1)))
    centers = {
        choice: project(splats, camera(), RenderSettings(prefilter_center=choice)).prefilter_center
        for choice in ("bounds", "parallelogram")
    }
    assert np.isfinite(centers["bounds"]).all() and np.isnan(centers["parallelogram"]).all()


@pytest.mark.parametrize("prefilter_radius", [1.0, 2.5])
def test_a_square_point_cuts_a_disc_off_the_axis(prefilter_radius):
    """A disc that faces the eye 60 degrees off the axis: its point has the side it would have in the middle."""
    cosine, sine, radius = 0.5, math.sqrt(3) / 2, 0.25
    row = (2 * sine, 0, 2 * cosine), (0, radius, 0), (radius * cosine, 0, -radius * sine)
    view = camera(f=8.0)
    drawn = [
        oracle.render(discs(row), view, RenderSettings(sprite=sprite, prefilter_radius=prefilter_radius))
        for sprite in ("exact", "point")
    ]
    off = np.abs(rays(view) * 8 - (8 * sine / cosine, 0)).max(axis=-1)
    whole, cut = (image["Z"] < np.inf for image in drawn)
    np.testing.assert_array_equal(cut, whole & (off <= radius * 8))
    np.testing.assert_array_equal(
        drawn[1]["count"] > 0, (drawn[0]["count"] > 0) & (off <= max(radius * 8, prefilter_radius))
    )
    assert cut.any() and (whole & ~cut).any()


# ---- the settings of others


def test_a_cutoff_of_gaussians_with_given_deviations():
    """[ZRB04]'s F_g: the Gaussian and its clip line stay in place, and F_g alone sets where it ends."""
    view, deviation, slope = camera(), 0.12, rays(camera())
    given = discs(facing_disc(2.0, deviation), clip=np.array([[[0.0, 1.0, 0.5], [0, 0, 0]]]))
    squared, x = (slope**2).sum(axis=-1) * 4 / deviation**2, slope[..., 0] * 2 / deviation
    for cutoff in (0.5, 1.5, 2.0):
        image = render(given.scaled(cutoff), view, cutoff=cutoff, epsilon=1.0)
        inside = (squared <= cutoff**2) & (x >= -0.5)
        assert_allclose(image["weight"], np.where(inside, np.exp(-squared / 2), 0), rtol=1e-9)
        assert inside.any()


@pytest.mark.parametrize("variance", [0.3, 0.1])
@pytest.mark.parametrize("footprint", ["affine", "conic"])
def test_a_variance_added_on_the_screen(variance, footprint):
    """Renderers that add 0.3 or 0.1 square pixels to the projected variance, and keep the Gaussian's integral."""
    given, pixels = discs(facing_disc(2.0, 0.04)), rays(camera()) * 32
    chosen = {"footprint": footprint, "prefilter": "ewa", "prefilter_radius": math.sqrt(variance), "cutoff": 3.0}
    image = render(given.scaled(3), camera(), **chosen)
    own = (32 * 0.04 / 2) ** 2
    squared = (pixels**2).sum(axis=-1) / (own + variance)
    expected = np.where(squared <= 9, own / (own + variance) * np.exp(-squared / 2), 0)
    assert_allclose(image["weight"], expected, rtol=1e-9)


def test_a_screen_filter_of_half_a_square_pixel():
    """2DGS: the lesser of r3^2 and 2 d^2, in squared deviations, cut at 3 deviations."""
    given, slope = discs(facing_disc(2.0, 0.02)), rays(camera())
    image = render(given.scaled(3), camera(), prefilter="min", prefilter_radius=3 * math.sqrt(0.5), cutoff=3.0)
    squared = np.minimum((slope**2).sum(axis=-1) * 4 / 0.02**2, 2 * (32 * slope**2 * 32).sum(axis=-1))
    assert_allclose(image["weight"], np.where(squared <= 9, np.exp(-squared / 2), 0), rtol=1e-9)


# ---- facing


@pytest.mark.parametrize("projection", PROJECTIONS)
def test_facing(projection):
    away = (0, 0, 2), (1, 0, 0), (0, 1, 0)
    view = camera(9, 8.0, projection=projection)
    expected = {"keep": 1.0, "flip": -1.0}
    for facing, z in expected.items():
        image = render(discs(away), view, facing=facing)
        assert_array_equal(image["N"][4, 4], [0, 0, z])
        assert_array_equal(render(discs(facing_disc()), view, facing=facing)["N"][4, 4], [0, 0, -1])
    for prefilter in ("none", "min"):
        image = render(discs(away), view, facing="cull", prefilter=prefilter)
        assert not image["count"].any()
        assert np.isinf(image["Z"]).all()
        assert render(discs(facing_disc()), view, facing="cull", prefilter=prefilter)["count"].any()
    projected = project(discs(away, facing_disc()), view, RenderSettings(facing="cull"))
    assert_array_equal(projected.culled, [True, False])
    assert projected.bounds[0, 0] > projected.bounds[0, 2]


def test_facing_is_decided_at_the_splat_by_its_plane():
    """The line of sight is (1, 0, 1) at x = z. The normal (1, 0, -0.5) faces away there, though its z does not."""
    row = (2, 0, 2), (0, 1, 0), (0.5, 0, 1)
    view = camera(33, 8.0)
    normal = np.cross(row[1], row[2])
    assert normal @ row[0] > 0 > normal[2]
    for projection, culled in [("perspective", True), ("orthographic", False)]:
        view = camera(33, 8.0, projection=projection)
        assert project(discs(row), view, RenderSettings(facing="cull")).culled[0] == culled
        flipped = project(discs(row), view, RenderSettings(facing="flip")).normal_eye[0]
        assert_allclose(flipped, (-1 if culled else 1) * normal / np.linalg.norm(normal))


def test_a_plane_through_the_eye_faces_away():
    """n.c is 0: only the pre-filter shows the splat, and culling drops it too."""
    row = (0, 0, 2), (0, 1, 0), (0, 0, 1)
    view = camera(9)
    assert render(discs(row), view, prefilter="min")["count"].any()
    assert not render(discs(row), view, prefilter="min", facing="cull")["count"].any()


@pytest.mark.parametrize("facing", ["keep", "flip", "cull"])
def test_unoriented_splats_are_turned_and_none_is_culled(facing):
    splats = dataclasses.replace(discs(((0, 0, 2), (1, 0, 0), (0, 1, 0))), oriented=False)
    assert_array_equal(render(splats, camera(9), facing=facing)["N"][4, 4], [0, 0, -1])
