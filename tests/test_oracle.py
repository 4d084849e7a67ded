"""The oracle against closed forms and against solvers that share nothing with it."""

from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from tolerances import (
    AREA_PER_PERIMETER,
    BOUNDS_RELATIVE,
    MARGIN_TYPICAL,
    NOISE_MARGIN,
    NOISE_UNITS,
    ORACLE_RELATIVE,
)

from splatcl import Camera, Light, Material, RenderSettings, Splats, oracle
from splatcl.errors import SettingsError

UNIT = 2.0**-24
NONE = 0xFFFFFFFF
PROJECTIONS = ("perspective", "orthographic")


def camera(size=33, f=32.0, pose=None, **kwargs):
    """A camera at the origin looking along +z; with an odd size the middle pixel looks straight ahead."""
    arguments = {"fx": f, "fy": f, "cx": size / 2, "cy": size / 2, "width": size, "height": size, "near": 0.01}
    return Camera(np.eye(4) if pose is None else pose, **{**arguments, **kwargs})


def discs(*rows, **kwargs):
    """Splats from (center, tangent_u, tangent_v) rows."""
    center, t_u, t_v = (np.array(column, np.float64) for column in zip(*rows, strict=True))
    return Splats(center, t_u, t_v, **kwargs)


def facing_disc(z=2.0, radius=1.0, x=0.0, y=0.0):
    """Centre and tangents of a disc of constant z whose normal looks at the eye (along -z)."""
    return (x, y, z), (0, radius, 0), (radius, 0, 0)


def render(splats, view, **kwargs):
    return oracle.render(splats, view, RenderSettings(**{"prefilter": "none", **kwargs}))


def rays(view):
    """(H, W, 2) s = (x - c) / f of the pixel centres."""
    x, y = np.meshgrid(np.arange(view.width) + 0.5, np.arange(view.height) + 0.5)
    return np.stack([(x - view.cx) / view.fx, (y - view.cy) / view.fy], axis=-1)


def solve(view, center, t_u, t_v):
    """(H, W, 3) u, v, z of one disc by a 3x3 solve of c + u t_u + v t_v = o + z d at each pixel."""
    s = rays(view)
    eye = view.eye_from_world
    center = eye[:3, :3] @ center + eye[:3, 3]
    one, zero = np.ones(s.shape[:2]), np.zeros(s.shape[:2])
    if view.projection == "perspective":
        origin, direction = np.stack([zero, zero, zero], -1), np.stack([s[..., 0], s[..., 1], one], -1)
    else:
        origin, direction = np.stack([s[..., 0], s[..., 1], zero], -1), np.stack([zero, zero, one], -1)
    columns = [np.broadcast_to(eye[:3, :3] @ t, direction.shape) for t in (t_u, t_v)]
    return np.linalg.solve(np.stack([*columns, -direction], -1), (origin - center)[..., None])[..., 0]


def random_rotation(rng):
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q * np.sign(np.linalg.det(q))


def random_splats(rng, num, size=0.3, z=(-0.5, 4.0), spread=1.0):
    """Random ellipses around the view axis, some behind the eye or through its plane."""
    depth = rng.uniform(*z, num)
    center = np.column_stack([rng.uniform(-spread, spread, (num, 2)) * np.abs(depth)[:, None], depth])
    frames = np.stack([random_rotation(rng) for _ in range(num)])
    radii = size * np.exp(rng.normal(0, 0.7, (num, 2)))
    return Splats(center, frames[:, 0] * radii[:, :1], frames[:, 1] * radii[:, 1:], rng.random((num, 3)))


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
    """A disc of radius 2 in the plane y = 1, of which the part in front of the near plane must appear."""
    view = camera(64, 32.0, near=0.75, far=1.5)
    image = render(discs(((0, 1, z), (0, 0, 2), (2, 0, 0))), view)
    s = rays(view)
    with np.errstate(divide="ignore"):
        depth = 1 / s[..., 1]
    hit = (depth >= 0.75) & (depth <= 1.5) & ((s[..., 0] * depth) ** 2 + (depth - z) ** 2 <= 4)
    assert 100 < np.count_nonzero(hit) < hit.size / 2
    assert_array_equal(np.isfinite(image["Z"]), hit)
    assert_allclose(image["Z"][hit], depth[hit], rtol=ORACLE_RELATIVE)
    bounds = oracle.project(discs(((0, 1, z), (0, 0, 2), (2, 0, 0))), view, RenderSettings()).bounds
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
    """The middle pixel's ray passes through the centre: it hits unless the disc counts as edge-on."""
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
    """Radius 4 pixels about a pixel centre: r = 0, 1/4 ... 1 along the row, the rim included."""
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
        # r = 0, 1/4, 1/2, 3/4, 1 over three samples: positions 0, 1/2, 1, 3/2, 2
        ({"kernel": "table", "kernel_table": (8, 4, 1)}, [8, 4, 4, 1, 1, 0]),
        ({"kernel": "table", "kernel_table": (8, 4, 1), "kernel_lookup": "linear"}, [8, 6, 4, 2.5, 1, 0]),
    ],
)
def test_kernels(kernel, expected):
    image = render(discs(facing_disc(2.0, 0.25)), camera(), **kernel)
    assert_array_equal(image["weight"][16, 16:22], expected)


def test_zero_weight_is_counted_but_not_covered():
    image = render(discs(facing_disc(2.0, 0.25)), camera(), kernel="table", kernel_table=(0, 0))
    assert image["count"][16, 16] == 1
    assert image["Z"][16, 16] == 2.0
    assert_array_equal(image["color"], 0)
    assert_array_equal(image["P"], 0)
    assert_array_equal(image["depth.mean"], np.inf)


# ---- pre-filter


@pytest.mark.parametrize(("radius", "num", "squares"), [(1.0, 4, (0.5,)), (2.0, 12, (0.5, 2.5))])
def test_sub_pixel_splat_lives_by_its_prefilter(radius, num, squares):
    """A tiny splat projected onto a corner of pixels: their centres are sqrt(1/2), sqrt(5/2) ... away."""
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
    """A slit 8 pixels long and 1/4 wide: r = min(|dx| / 4, |(dx, dy)|) on its row, |(dx, dy)| off it."""
    image = render(discs(((0, 0, 2), (0, 1 / 64, 0), (0.25, 0, 0))), camera(), prefilter="min")
    assert_allclose(image["weight"][16, 16:22], [math.exp(-(k**2) / 8) for k in range(5)] + [0])
    assert_allclose(image["weight"][17, 16:19], [math.exp(-2), 0, 0])
    assert_array_equal(np.isfinite(image["Z"][15:18, 16]), [False, True, False])
    assert image["weight"][17, 16] == pytest.approx(math.exp(-2))


def test_prefilter_fragment_lies_at_its_centre_and_obeys_the_depth_test():
    """A tiny splat 0.1 behind or before a wall: visible within epsilon, and never in the depth buffer."""
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


def test_prefilter_needs_a_centre_in_range():
    for z, visible in [(0.9, False), (1.0, True), (3.0, True), (3.1, False), (-1.0, False)]:
        image = render(discs(facing_disc(z, 1e-4)), camera(32, near=1.0, far=3.0), prefilter="min")
        assert image["count"].any() == visible


def test_prefilter_about_the_projected_bounds():
    """A disc turned by 60 degrees about y: its left and right edges project to u = -1 and 1."""
    cosine, sine, radius, f = 0.5, math.sqrt(3) / 2, 1.0, 32.0
    row = (0, 0, 2), (0, radius, 0), (radius * cosine, 0, radius * sine)
    edges = [f * u * cosine / (2 + u * sine) + 16.5 for u in (-1, 1)]
    for choice, x in [("projected", 16.5), ("bounds", sum(edges) / 2)]:
        chosen = RenderSettings(prefilter_center=choice)
        projected = oracle.project(discs(row), camera(), chosen)
        assert_allclose(projected.prefilter_center, [[x, 16.5]], rtol=ORACLE_RELATIVE)
        assert_allclose(projected.center_raster, [[16.5, 16.5]], rtol=ORACLE_RELATIVE)
        assert_allclose(projected.bounds[0, [0, 2]], edges, rtol=ORACLE_RELATIVE)
    # The same disc shrunk below a pixel keeps the two centres apart only by its perspective; large, it shows.
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
    projected = oracle.project(splats, camera(), RenderSettings(prefilter_center="bounds"))
    assert np.isnan(projected.prefilter_center).all()
    assert np.isfinite(oracle.project(splats, camera(), RenderSettings()).prefilter_center).all()


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
    projected = oracle.project(discs(away, facing_disc()), view, RenderSettings(facing="cull"))
    assert_array_equal(projected.culled, [True, False])
    assert projected.bounds[0, 0] > projected.bounds[0, 2]


def test_facing_is_decided_at_the_splat_by_its_plane():
    """At x = z the line of sight is (1, 0, 1): a normal (-1, 0, 0.5) faces the eye though its z points away."""
    row = (2, 0, 2), (0, 1, 0), (0.5, 0, 1)
    view = camera(33, 8.0)
    normal = np.cross(row[1], row[2])
    assert normal @ row[0] > 0 > normal[2]
    for projection, culled in [("perspective", True), ("orthographic", False)]:
        view = camera(33, 8.0, projection=projection)
        assert oracle.project(discs(row), view, RenderSettings(facing="cull")).culled[0] == culled
        flipped = oracle.project(discs(row), view, RenderSettings(facing="flip")).normal_eye[0]
        assert_allclose(flipped, (-1 if culled else 1) * normal / np.linalg.norm(normal))


def test_a_plane_through_the_eye_faces_away():
    """n.c = 0: only the pre-filter can show it, and culling takes that too."""
    row = (0, 0, 2), (0, 1, 0), (0, 0, 1)
    view = camera(9)
    assert render(discs(row), view, prefilter="min")["count"].any()
    assert not render(discs(row), view, prefilter="min", facing="cull")["count"].any()


def test_unoriented_splats_are_turned_and_cannot_be_culled():
    splats = dataclasses.replace(discs(((0, 0, 2), (1, 0, 0), (0, 1, 0))), oriented=False)
    assert_array_equal(render(splats, camera(9), facing="keep")["N"][4, 4], [0, 0, -1])
    with pytest.raises(SettingsError, match="oriented"):
        render(splats, camera(9), facing="cull")


# ---- visibility and attributes


@pytest.mark.parametrize(("behind", "count"), [(0.25, 2), (0.2499, 2), (0.2501, 1), (-0.2501, 1), (-0.25, 2)])
def test_epsilon_along_z_is_inclusive(behind, count):
    image = render(discs(facing_disc(2.0, 9.0), facing_disc(2.0 + behind, 9.0)), camera(9), epsilon=0.25)
    assert_array_equal(image["count"], count)
    assert_allclose(image["Z"], min(2.0, 2.0 + behind), rtol=ORACLE_RELATIVE)
    assert_array_equal(image["particleid"], int(behind < 0))


def test_epsilon_zero_keeps_the_front_splat_and_its_ties():
    image = render(discs(*[facing_disc(2.0, 9.0)] * 3, facing_disc(2.001, 9.0)), camera(9), epsilon=0.0)
    assert_array_equal(image["count"], 3)
    assert_array_equal(image["particleid"], 0)


def test_epsilon_along_the_ray():
    """Layers 0.1 apart in z are 0.1 |d| apart along the ray."""
    view = camera(33, 16.0)
    splats = discs(facing_disc(2.0, 9.0), facing_disc(2.1, 9.0))
    length = np.sqrt(1 + (rays(view) ** 2).sum(axis=-1))
    image = render(splats, view, epsilon=0.13, along="ray")
    assert_array_equal(image["count"], np.where(0.1 * length <= 0.13, 2, 1))
    assert set(np.unique(image["count"])) == {1, 2}
    assert_array_equal(render(splats, view, epsilon=0.13)["count"], 2)
    flat = camera(33, 16.0, projection="orthographic")
    assert_array_equal(render(splats, flat, epsilon=0.1000001, along="ray")["count"], 2)


def test_auto_epsilon_is_the_median_radius():
    splats = discs(facing_disc(2.0, 0.5), facing_disc(2.4, 9.0), ((0, 0, 2), (0, 3, 0), (0.4, 0, 0)))
    assert oracle.auto_epsilon(splats) == 3.0
    assert oracle.auto_epsilon(splats.take([0])) == 0.5
    assert_array_equal(render(splats.take([0, 0, 1]), camera(3), epsilon="auto")["count"], 3)
    assert_array_equal(render(splats.take([0, 0, 1]), camera(3), epsilon=0.3)["count"], 2)


def test_fragments_blend_by_weight():
    """Two discs of radii 1 and 2 about the axis, 0.1 apart, the second tilted by its normal field only."""
    tilted = (0, 0, 2.1), (0, 2, 0), (2 * 0.6, 0, 2 * 0.8)
    splats = discs(facing_disc(2.0, 1.0), tilted, color=np.array([[1.0, 0, 0], [0, 0.5, 1.0]]))
    view = camera(33, 64.0)
    image = render(splats, view, epsilon=0.5, shader="albedo")
    s = rays(view)
    z_tilted = 2.1 / (1 - s[..., 0] * 0.8 / 0.6)  # x / 0.6 = (z - 2.1) / 0.8
    first = np.exp(-2 * 4 * (s**2).sum(axis=-1))
    second = np.exp(-2 * z_tilted**2 * ((s[..., 0] / 1.2) ** 2 + (s[..., 1] / 2) ** 2))
    both = z_tilted <= np.minimum(2.0, z_tilted) + 0.5
    assert both[16, 16] and not both.all()
    second = second * both
    first = first * (np.minimum(2.0, z_tilted) + 0.5 >= 2.0)
    total = first + second
    assert_allclose(image["weight"], total, rtol=1e-10)
    red = first / total
    assert_allclose(image["albedo"], np.stack([red, 0.5 * (1 - red), 1 - red], -1), atol=1e-10)
    assert_allclose(image["color"][..., :3], image["albedo"])
    assert_allclose(image["depth.mean"], red * 2.0 + (1 - red) * z_tilted, rtol=1e-10)
    front = np.where(first > 0, np.minimum(2.0, z_tilted), z_tilted)
    assert_allclose(image["Z"], front, rtol=1e-10)
    assert_allclose(image["P"][..., 2], front, rtol=1e-10)
    assert_allclose(image["depth.distance"], front * np.sqrt(1 + (s**2).sum(axis=-1)), rtol=1e-10)
    normal = first[..., None] * [0, 0, -1] + second[..., None] * [0.8, 0, -0.6]
    assert_allclose(image["N"], normal / np.linalg.norm(normal, axis=-1, keepdims=True), atol=1e-10)


def test_opposite_normals_cancel_to_zero():
    splats = discs(facing_disc(2.0, 1.0), ((0, 0, 2), (1, 0, 0), (0, 1, 0)))
    image = render(splats, camera(9))
    assert_array_equal(image["N"][4, 4], 0)
    assert image["color"][4, 4, 3] == 1


def test_nothing_at_all():
    empty = discs(facing_disc()).take(np.arange(0))
    for splats in (empty, discs(facing_disc(-2.0))):
        image = render(splats, camera(5), prefilter="min")
        for name in ("color", "P", "N", "albedo", "weight", "count"):
            assert not image[name].any(), name
        for name in ("Z", "depth.mean", "depth.distance"):
            assert_array_equal(image[name], np.inf)
        assert_array_equal(image["particleid"], NONE)
    assert_array_equal(render(empty, camera(5))["margin"], np.inf)


# ---- shading


def test_phong_closed_forms():
    """A facing wall: at the middle, N = V = (0, 0, -1) and z = 2."""
    splats = discs(facing_disc(2.0, 3.0), color=np.array([[0.5, 0.25, 1.0]]))
    albedo = np.array([0.5, 0.25, 1.0])
    material = Material(ambient=0.1, diffuse=0.7, specular=0.4, shininess=3.0)
    half = math.sqrt(0.5)
    cases = [
        (Light("headlight"), 1.0, 1.0),
        (Light("directional", (0, 3, -3)), half, half),
        (Light("directional", (0, 0, 1)), 0.0, 0.0),
        (Light("point", (2, 0, 0)), half, half),
        (Light("point", (0, 0, 3)), 0.0, 0.0),
        (Light("directional", (0, -1, -0.1)), 0.1 / math.hypot(1, 0.1), 0.1 / math.hypot(1, 0.1)),
    ]
    for light, n_l, r_v in cases:
        image = render(splats, camera(9), lights=(light,), material=material)
        expected = albedo * (0.1 + 0.7 * n_l) + 0.4 * r_v**3
        assert_allclose(image["color"][4, 4], [*expected, 1.0], rtol=ORACLE_RELATIVE)
    coloured = tuple(dataclasses.replace(light, color=(1.0, 2.0, 0.5)) for light, *_ in cases[:2])
    image = render(splats, camera(9), lights=coloured, material=material)
    expected = albedo * (0.1 + 0.7 * (1 + half) * np.array([1, 2, 0.5])) + 0.4 * (1 + half**3) * np.array([1, 2, 0.5])
    assert_allclose(image["color"][4, 4, :3], expected, rtol=ORACLE_RELATIVE)


def test_a_light_behind_the_surface_leaves_the_ambient_part():
    """N = (0.8, 0, -0.6); the light's mirror image looks at the eye, but N.L < 0."""
    light = Light("directional", (0.52, 0, 0.86))
    image = render(discs(((0, 0, 2), (0, 1, 0), (0.6, 0, 0.8))), camera(9), lights=(light,))
    assert_allclose(image["color"][4, 4, :3], np.float32(0.6) * 0.1, rtol=ORACLE_RELATIVE)


@pytest.mark.parametrize("projection", PROJECTIONS)
def test_headlight_and_specular_follow_the_eye(projection):
    """Off the axis a perspective eye sees the wall at cos = 1 / |d|; an orthographic one always straight."""
    view = camera(9, 4.0, projection=projection)
    material = Material(ambient=0.0, diffuse=1.0, specular=1.0, shininess=5.0)
    image = render(discs(facing_disc(2.0, 9.0)), view, material=material)
    length = np.sqrt(1 + (rays(view) ** 2).sum(axis=-1)) if projection == "perspective" else np.ones((9, 9))
    r_v = 2 / length**2 - 1  # the mirror of V about N, against V
    expected = np.float32(0.6) / length + np.maximum(r_v, 0) ** 5
    assert_allclose(image["color"][..., 0], expected, rtol=1e-10)


def test_lights_are_in_world_space():
    pose = np.eye(4)
    pose[:3, :3] = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]  # the eye looks along world y, world z is up
    pose[:3, 3] = 0, 0, 2
    splats = discs(((0, 0, 0), (1, 0, 0), (0, 0, 1)))  # normal -y: toward the eye at (0, -2, 0)
    material = Material(0.0, 1.0, 0.0, 1.0)
    for light in (Light("directional", (0, -1, 1)), Light("point", (0, -3, 3)), Light("point", (3, -3, 0))):
        image = render(splats, camera(9, pose=pose), lights=(light,), material=material)
        assert image["color"][4, 4, 0] == pytest.approx(np.float32(0.6) * math.sqrt(0.5))
        assert_allclose(image["N"][4, 4], [0, 0, -1], atol=1e-15)


def test_normal_shader():
    slanted = (0, 0, 2), (0, 1, 0), (0.6, 0, 0.8)  # normal (0.8, 0, -0.6)
    raised = (0, 0, 2), (0, 0.6, 0.8), (1, 0, 0)  # normal (0, 0.8, -0.6), down in the image
    cases = [(facing_disc(), (0.5, 0.5, 1.0)), (slanted, (0.9, 0.5, 0.8)), (raised, (0.5, 0.1, 0.8))]
    for row, expected in cases:
        assert_allclose(render(discs(row), camera(9), shader="normal")["color"][4, 4, :3], expected)


# ---- bounds and tiles


def rim_extremes(view, center, t_u, t_v, num=512):
    """(x_min, y_min, x_max, y_max) of a disc's projection: samples of the rim, each extreme polished."""
    angle = np.arange(num) * 2 * np.pi / num

    def raster(a):
        return view.project(center + np.cos(a)[..., None] * t_u + np.sin(a)[..., None] * t_v)[0]

    extremes = []
    for sign, axis in itertools.product((-1, 1), (0, 1)):
        best = angle[np.argmax(sign * raster(angle)[:, axis])]
        step = angle[1]
        for _ in range(4):  # Newton's method on three samples
            low, middle, high = sign * raster(best + np.array([-step, 0, step]))[:, axis]
            curvature = low - 2 * middle + high
            best += step * (low - high) / (2 * curvature) if curvature < 0 else 0.0
            step /= 8
        extremes.append(raster(np.array([best]))[0, axis])
    return np.array(extremes)


@pytest.mark.parametrize("projection", PROJECTIONS)
@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_bounds_are_the_rims_extremes(projection, seed):
    rng = np.random.default_rng(seed)
    view = camera(16, 12.0, cx=3.0, fy=9.0, near=0.01, projection=projection)
    splats = random_splats(rng, 1, size=0.5, z=(0.0, 3.0))
    row = splats.center[0], splats.tangent_u[0], splats.tangent_v[0]
    bounds = oracle.project(splats, view, RenderSettings(prefilter="none")).bounds[0]
    reach = math.hypot(row[1][2], row[2][2])
    if row[0][2] - reach > 0.05 or (projection == "orthographic" and row[0][2] > 0.05):
        expected = rim_extremes(view, *row)
        size = (expected[2:] - expected[:2]).max()
        assert_allclose(bounds, expected, atol=BOUNDS_RELATIVE * size, rtol=0)
    elif projection == "perspective" and row[0][2] - reach <= 0:
        assert_array_equal(bounds, [-np.inf, -np.inf, np.inf, np.inf])


def test_bounds_include_the_prefilter_and_exclude_what_cannot_be_seen():
    rows = [
        facing_disc(2.0, 1 / 64),  # a quarter of a pixel: 16.5 +- 1 by its pre-filter
        ((0, 0, 2), (0, 1 / 64, 0), (0.25, 0, 0)),  # 16.5 +- 4 by 16.5 +- 1
        facing_disc(-2.0, 1.0),
        facing_disc(9.0, 1.0),
        ((0, 0, 2), (0, 1, 0), (0, 0, 1)),  # edge-on: the pre-filter only
    ]
    projected = oracle.project(discs(*rows), camera(far=8.0), RenderSettings())
    assert_allclose(projected.bounds[0], [15.5, 15.5, 17.5, 17.5])
    assert_allclose(projected.bounds[1], [12.5, 15.5, 20.5, 17.5])
    assert_array_equal(projected.bounds[2:4], [oracle.NOTHING] * 2)
    assert_allclose(projected.bounds[4], [15.5, 15.5, 17.5, 17.5])
    assert_array_equal(np.isnan(projected.center_raster[:, 0]), [False, False, True, False, False])


@pytest.mark.parametrize("settings_", [{}, {"prefilter_center": "bounds"}, {"facing": "cull"}, {"prefilter": "none"}])
@pytest.mark.parametrize("projection", PROJECTIONS)
def test_bounds_and_tiles_contain_every_fragment(projection, settings_):
    f = 20.0 if projection == "perspective" else 7.0
    view = camera(29, f, width=23, near=0.2, projection=projection)
    splats = random_splats(np.random.default_rng(3), 60, size=0.15)
    chosen = RenderSettings(**settings_)
    projected = oracle.project(splats, view, chosen)
    tiles = oracle.bin(projected, view, 8)
    assert len(tiles) == 4 * 3
    total = 0
    for k in range(len(splats)):
        y, x = np.nonzero(oracle.render(splats.take([k]), view, chosen)["count"])
        total += len(x)
        x_min, y_min, x_max, y_max = projected.bounds[k]
        assert ((x + 0.5 >= x_min) & (x + 0.5 <= x_max) & (y + 0.5 >= y_min) & (y + 0.5 <= y_max)).all()
        assert all(k in tiles[t] for t in np.unique(y // 8 * 3 + x // 8))
    assert total > 60
    assert all((np.diff(tile) > 0).all() for tile in tiles)


def test_a_tile_is_reached_at_its_pixel_centres():
    """Pixel centres of 16-pixel tiles lie in [0.5, 15.5] and [16.5, 31.5], of the last one in [32.5, 32.5]."""
    cases = [
        ((-1, 0.25), []), ((-1, 0.5), [0]), ((14.5, 15.5), [0]), ((15.5, 16.5), [0, 1]), ((15.75, 16.25), []),
        ((15.75, 16.5), [1]), ((31.5, 32.25), [1]), ((31.75, 32.25), []), ((32.25, 32.5), [2]),
        ((32.5, 33), [2]), ((32.75, 33.5), []), ((-5, 50), [0, 1, 2]), ((10, 20), [0, 1]),
    ]  # fmt: skip
    for (x_min, x_max), columns in cases:
        center, _, t_v = facing_disc(1.0, (x_max - x_min) / 64, x=(x_min + x_max) / 64)
        splats = discs((center, (0, 2.0**-5, 0), t_v))
        for turned, where in [(False, columns), (True, [3 * c for c in columns])]:
            if turned:
                view = camera(33, 32.0, cx=0.5, cy=0.0)
                splats = discs(((0, center[0], 1), (2.0**-5, 0, 0), (0, t_v[0], 0)))
            else:
                view = camera(33, 32.0, cx=0.0, cy=0.5)
            tiles = oracle.bin(oracle.project(splats, view, RenderSettings(prefilter="none")), view, 16)
            assert [k for k in range(9) if len(tiles[k])] == where, (x_min, x_max, turned)


# ---- the margin


def with_noise(rng, splats, view):
    """Splats of a camera at the origin, moved by float32's errors times NOISE_UNITS: their projected centres by
    OFFSET_ERROR, z and the tangents in proportion."""
    noise = NOISE_UNITS * UNIT
    z = splats.center[:, 2:]
    pixel = np.hstack([z / view.fx, z / view.fy]) if view.projection == "perspective" else 1 / view.fx
    moved = splats.center + np.eye(3)[2] * z * noise * rng.uniform(-1, 1, z.shape)
    if view.projection == "perspective":
        moved = splats.center * (moved[:, 2:] / z)
    moved[:, :2] += oracle.OFFSET_ERROR * noise * pixel * rng.uniform(-1, 1, (len(splats), 2))
    tangents = [
        t + noise * np.linalg.norm(t, axis=1, keepdims=True) * rng.uniform(-1, 1, t.shape)
        for t in (splats.tangent_u, splats.tangent_v)
    ]
    return Splats(moved, *tangents, splats.color)


@pytest.mark.parametrize(("pixels", "shift"), [(9.6, 0.0), (2.0**-20, 2.0**-21)])
def test_margin_of_a_facing_disc(pixels, shift):
    """A = 1 / radius, G = 0, kappa = 1: |1 - r| over (|dx| + |dy| + 2^-22) / radius + 2, in 2^-24."""
    view = camera(33, cx=16.5 - shift)
    margin = render(discs(facing_disc(2.0, pixels / 16)), view)["margin"]
    dx, dy = np.abs(np.moveaxis(rays(view), -1, 0)) * 32
    expected = np.abs(1 - np.hypot(dx, dy) / pixels) / (UNIT * ((dx + dy + 2.0**-22) / pixels + 2))
    edge_on = (1 - 2.0**-16) / 4 / UNIT
    assert_allclose(margin, np.where(dx**2 + dy**2 <= pixels**2, np.minimum(expected, edge_on), expected), rtol=1e-6)


@pytest.mark.parametrize("projection", PROJECTIONS)
def test_margin_of_a_tilted_ellipse_is_the_one_defined(projection):
    """The linear forms A, B, G are found by differencing linear solves; kappa is worked out by hand."""
    radii, cosine, sine = (0.9, 0.3), 0.6, 0.8
    center, t_u, t_v = (
        np.array([0, 0, 2.0]),
        np.array([radii[0] * cosine, 0, radii[0] * sine]),
        np.array([0, radii[1], 0]),
    )
    view = camera(16, 12.0, near=1.99, projection=projection)
    kappa = radii[0] / radii[1] / cosine

    def forms(view):
        u, v, z = np.moveaxis(solve(view, center, t_u, t_v), -1, 0)
        den = 2 / z if projection == "perspective" else np.ones(z.shape)
        return np.stack([u * den, v * den, den, z])

    here = forms(view)
    step_x = forms(dataclasses.replace(view, cx=view.cx - view.fx)) - here
    step_y = forms(dataclasses.replace(view, cy=view.cy - view.fy)) - here
    e_x, e_y = np.moveaxis(np.abs(rays(view)) + 2.0**-23 / 12, -1, 0)
    change = np.abs(step_x) * e_x + np.abs(step_y) * e_y
    den, z = here[2], here[3]
    signed_r = (den - np.hypot(*here[:2])) / (change[:3].sum(axis=0) + 1 + kappa) / UNIT
    if projection == "perspective":
        scale_z = np.abs(z) * (1 + (1 + kappa) * change[2]) / np.abs(den)
    else:
        scale_z = np.abs(z) + (1 + kappa) * change[3]
    edge_on = (0.6 - 2.0**-16) / 4 / UNIT
    expected = np.abs(np.minimum(np.minimum(signed_r, edge_on), (z - 1.99) / scale_z / UNIT))
    image = render(discs((center, t_u, t_v)), view)
    assert_allclose(image["margin"], expected, rtol=1e-6)
    assert np.count_nonzero(expected == np.abs(z - 1.99) / scale_z / UNIT) > 3


def test_margin_of_a_prefilter_and_of_its_disc_together():
    view = camera(32)
    image = render(discs(facing_disc(2.0, 1e-4)), view, prefilter="min", prefilter_radius=1.5)
    r = np.hypot(*np.moveaxis(rays(view), -1, 0)) * 32 / 1.5
    expected = np.abs(1 - r**2) / (UNIT * (2 * r**2 + 8 * r / 1.5))
    radius = 32 * 1e-4 / 2
    dx, dy = np.abs(np.moveaxis(rays(view), -1, 0)) * 32
    disc = np.abs(1 - np.hypot(dx, dy) / radius) / (UNIT * ((dx + dy + 2.0**-22) / radius + 2))
    assert_allclose(image["margin"], np.minimum(expected, disc), rtol=1e-6)


def test_margin_of_a_prefilter_about_the_bounds():
    """The bounds' centre errs by its offset from the projected centre times (z^2 + t_z^2) / (z^2 - t_z^2)."""
    cosine, sine = 0.5, math.sqrt(3) / 2
    row = (0, 0, 2), (0, 0.1, 0), (cosine, 0, sine)
    offset = sum(32 * u * cosine / (2 + u * sine) for u in (-1, 1)) / 2
    error = 2 + abs(offset) * (4 + sine**2) / (4 - sine**2)
    radius = (8 - offset) * (1 + 1e-7)  # the pixel 8 to the right of the middle is just inside
    chosen = RenderSettings(prefilter_center="bounds", prefilter_radius=radius)
    margin = oracle.render(discs(row), camera(), chosen)["margin"]
    assert margin[16, 24] == pytest.approx(2e-7 / (UNIT * (2 + 4 * error / radius)), rel=1e-4)


@pytest.mark.parametrize("projection", PROJECTIONS)
def test_margin_of_depth_decisions(projection):
    view = camera(3, 8.0, projection=projection)
    layers = discs(facing_disc(2.0, 1e3), facing_disc(2.0 + 1e-6, 1e3), facing_disc(2.3 - 1e-5, 1e3))
    image = render(layers, view, epsilon=0.3)
    epsilon_margin = 1e-5 / (2.0 + 2.3 + 0.3) / UNIT
    identity_margin = 1e-6 / (2.0 + 2.0) / UNIT
    assert_allclose(image["margin"], min(epsilon_margin, identity_margin), rtol=1e-3)
    two = render(layers.take([0, 2]), view, epsilon=0.3)
    assert_allclose(two["margin"], epsilon_margin, rtol=1e-3)
    depth = oracle.visibility(oracle.project(layers, view, RenderSettings()), view, RenderSettings())
    assert_allclose(depth.margin, identity_margin, rtol=1e-3)
    assert (depth.depth_margin > 1e6).all()
    alone = render(layers.take([0]), view, epsilon=0.0)
    assert (alone["margin"] > 1e6).all()  # the front splat's own depth test is no decision


@pytest.mark.parametrize("plane", [{"near": 2 - 1e-6}, {"near": 2 + 1e-6}, {"far": 2 - 1e-6}, {"far": 2 + 1e-6}])
@pytest.mark.parametrize("prefilter", ["none", "min"])
def test_margin_of_near_and_far_only_where_the_splat_is(plane, prefilter):
    image = render(discs(facing_disc(2.0, 0.25)), camera(33, **plane), prefilter=prefilter)
    touched = np.hypot(*np.moveaxis(rays(camera(33)), -1, 0)) * 32 < 3.9
    assert_allclose(image["margin"][touched], 1e-6 / 2 / UNIT, rtol=1e-3)
    away = np.hypot(*np.moveaxis(rays(camera(33)), -1, 0)) * 32 > 4.1
    assert (image["margin"][away] > 1e4).all()


@pytest.mark.parametrize("facing", ["keep", "flip", "cull"])
@pytest.mark.parametrize("side", [-1, 1])
def test_margin_of_facing_only_where_the_splat_is(facing, side):
    """A disc 2^-10 from edge-on: as near to turning as to 2^-16, on its line of pixels only."""
    angle = side * 2.0**-10
    row = (0, 0, 2), (0, 0.25, 0), (0.25 * math.sin(angle), 0, 0.25 * math.cos(angle))
    image = render(discs(row), camera(33), facing=facing, prefilter="min", prefilter_radius=1.5)
    cosine = math.sin(abs(angle))
    edge, turn = (cosine - 2.0**-16) / 4 / UNIT, cosine / 4 / UNIT
    if facing == "cull" and side < 0:
        assert_allclose(image["margin"][16, 16], turn, rtol=1e-9)
    else:
        assert image["margin"][16, 16] <= edge * (1 + 1e-9)
    if facing == "keep":
        assert image["margin"][16, 17] > 1e5
    else:
        assert_allclose(image["margin"][16, 17], turn, rtol=1e-9)  # by the pre-filter alone
    assert (image["margin"][:, 20:] > 1e5).all()


@pytest.mark.parametrize("projection", PROJECTIONS)
@pytest.mark.parametrize(
    "choices",
    [
        {"facing": "cull"},
        {"facing": "flip", "prefilter_center": "bounds"},
        {"prefilter": "none", "along": "ray"},
    ],
)
def test_margin_predicts_flips(projection, choices):
    """Noise of float32's kind, magnified, flips only decisions whose margin is of the noise's size."""
    chosen = RenderSettings(epsilon=0.2, **choices)
    view = camera(32, 32.0 if projection == "perspective" else 10.0, near=0.4, far=3.5, projection=projection)
    near, ever_flipped = [], []
    for seed in range(3):
        rng = np.random.default_rng(seed)
        splats = random_splats(rng, 80, size=0.2)
        image = oracle.render(splats, view, chosen)
        near.append(image["margin"] < NOISE_UNITS)
        ever_flipped.append(np.zeros(near[-1].shape, bool))
        for _ in range(8):
            noisy = with_noise(rng, splats, view)
            epsilon = 0.2 * (1 + NOISE_UNITS * UNIT * rng.uniform(-1, 1))
            other = oracle.render(noisy, view, dataclasses.replace(chosen, epsilon=epsilon))
            flipped = (image["count"] != other["count"]) | (image["particleid"] != other["particleid"])
            ever_flipped[-1] |= flipped
            assert (image["margin"][flipped] < NOISE_MARGIN * NOISE_UNITS).all(), seed
            # A splat that turns around must have warned the pixels that it touches.
            before, after = (oracle.project(s, view, chosen) for s in (splats, noisy))
            turned = (before.culled != after.culled) | ((before.normal_eye * after.normal_eye).sum(axis=1) < 0)
            for k in np.flatnonzero(turned):
                alone = oracle.render(splats.take([k]), view, dataclasses.replace(chosen, facing="keep"))
                assert (image["margin"][alone["count"] > 0] < NOISE_MARGIN * NOISE_UNITS).all()
    near, ever_flipped = np.array(near), np.array(ever_flipped)
    assert np.count_nonzero(ever_flipped) >= 5
    assert np.count_nonzero(ever_flipped) > 0.05 * np.count_nonzero(near)  # it does not cry wolf


def float32_disc(s, f, center, t_u, t_v):
    """den - |(u, v)| den and z of the ray s, in float32 relative to the projected centre."""
    c, t_u, t_v, f = (np.float32(value) for value in (center, t_u, t_v, f))
    a, b, g = np.cross(t_v, c), np.cross(c, t_u), np.cross(t_u, t_v)
    scale = f * (g @ c) / c[2]
    d = np.float32((s - center[:2] / center[2]) * float(f))
    den = np.float32(1) + g[:2] @ d / scale
    return float(den) - math.hypot(a[:2] @ d / scale, b[:2] @ d / scale), float(c[2] / den)


@pytest.mark.parametrize("aspect", [1.0, 5.0, 100.0])
def test_margin_is_in_units_of_float32_error(aspect):
    """At a rim pixel and at a near plane: float32's error is at most MARGIN_TYPICAL, and not far below."""
    rng = np.random.default_rng(1)
    f, errors_r, errors_z = 500.0, [], []
    while len(errors_r) < 200:
        splat = random_splats(rng, 1, size=0.1, z=(1.0, 3.0), spread=0.5)
        center, t_u, t_v = splat.center[0], aspect * splat.tangent_u[0], splat.tangent_v[0]
        angle, inside = rng.uniform(0, 2 * np.pi), 1 - 1e-5
        point = center + inside * (math.cos(angle) * t_u + math.sin(angle) * t_v)
        if point[2] < 0.2 or center[2] < math.hypot(t_u[2], t_v[2]):
            continue
        s = point[:2] / point[2]
        one = {"f": f, "cx": 0.5 - f * s[0], "cy": 0.5 - f * s[1]}
        value, z = float32_disc(s, f, center, t_u, t_v)
        den = center[2] / point[2]
        margin = render(discs((center, t_u, t_v)), camera(1, **one))["margin"][0, 0]
        errors_r.append(abs(value - (1 - inside) * den) / ((1 - inside) * den) * margin)
        near = 0.999999 * point[2]
        margin = render(discs((center, 2 * t_u, 2 * t_v)), camera(1, **one, near=near))["margin"][0, 0]
        errors_z.append(abs(z - point[2]) / (point[2] - near) * margin)
    for errors in (errors_r, errors_z):
        assert max(errors) < MARGIN_TYPICAL
    assert np.median(errors_r) > 0.01
    assert max(errors_z) > 0.1


def test_margin_is_large_almost_everywhere():
    """On a sphere of overlapping splats, less than one pixel in twenty is within a thousand roundings."""
    rng = np.random.default_rng(0)
    normal = rng.normal(size=(600, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    t_u = np.cross(normal, [0.3, 0.5, 0.8])
    t_u *= 0.15 / np.linalg.norm(t_u, axis=1, keepdims=True)
    view = Camera.look_at((0, 0, 3), (0, 0, 0), width=48, height=48)
    image = oracle.render(Splats(normal, t_u, np.cross(normal, t_u)), view, RenderSettings())
    assert np.median(image["margin"]) > 1e4
    assert np.mean(image["margin"] < 1e3) < 0.05
