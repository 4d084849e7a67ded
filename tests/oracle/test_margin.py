"""The oracle's decision margins: their definition, and that they predict which decisions flip."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from helpers.oracle_cases import (
    PROJECTIONS,
    UNIT,
    camera,
    discs,
    facing_disc,
    random_splats,
    rays,
    render,
    solve,
)
from numpy.testing import assert_allclose
from tolerances import (
    MARGIN_TYPICAL,
    NOISE_MARGIN,
    NOISE_UNITS,
)

from splatcl import Camera, RenderSettings, Splats, oracle
from splatcl.oracle.geometry.rays import OFFSET_ERROR
from splatcl.oracle.project import project
from splatcl.oracle.visibility import visibility

# ---- the margin


def with_noise(rng, splats, view):
    """Return splats moved by float32's errors times NOISE_UNITS, for a camera at the origin.

    The projected centers move by up to OFFSET_ERROR; z and the tangents move in proportion to their size.
    """
    noise = NOISE_UNITS * UNIT
    z = splats.center[:, 2:]
    pixel = np.hstack([z / view.fx, z / view.fy]) if view.projection == "perspective" else 1 / view.fx
    moved = splats.center + np.eye(3)[2] * z * noise * rng.uniform(-1, 1, z.shape)
    if view.projection == "perspective":
        moved = splats.center * (moved[:, 2:] / z)
    moved[:, :2] += OFFSET_ERROR * noise * pixel * rng.uniform(-1, 1, (len(splats), 2))
    tangents = [
        t + noise * np.linalg.norm(t, axis=1, keepdims=True) * rng.uniform(-1, 1, t.shape)
        for t in (splats.tangent_u, splats.tangent_v)
    ]
    return Splats(moved, *tangents, splats.color)


@pytest.mark.parametrize(("pixels", "shift"), [(9.6, 0.0), (2.0**-20, 2.0**-21)])
def test_margin_of_a_facing_disc(pixels, shift):
    """The margin is |1 - r| over (|dx| + |dy| + 4) / radius + 2, in 2^-24: A = 1 / radius, G = 0, kappa = 1."""
    view = camera(33, cx=16.5 - shift)
    margin = render(discs(facing_disc(2.0, pixels / 16)), view)["margin"]
    dx, dy = np.abs(np.moveaxis(rays(view), -1, 0)) * 32
    expected = np.abs(1 - np.hypot(dx, dy) / pixels) / (UNIT * ((dx + dy + 4.0) / pixels + 2))
    edge_on = (1 - 2.0**-16) / 4 / UNIT
    assert_allclose(margin, np.where(dx**2 + dy**2 <= pixels**2, np.minimum(expected, edge_on), expected), rtol=1e-6)


@pytest.mark.parametrize("projection", PROJECTIONS)
def test_margin_of_a_tilted_ellipse_is_the_defined_one(projection):
    """Differences of linear solves give the linear forms A, B, G; kappa is computed by hand."""
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
    e_x, e_y = np.moveaxis(np.abs(rays(view)) + 2.0 / 12, -1, 0)
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
    disc = np.abs(1 - np.hypot(dx, dy) / radius) / (UNIT * ((dx + dy + 4.0) / radius + 2))
    assert_allclose(image["margin"], np.minimum(expected, disc), rtol=1e-6)


def test_margin_of_a_prefilter_about_the_bounds():
    """The error of the bounds' center is its offset from the projected center times (z^2 + t_z^2) / (z^2 - t_z^2)."""
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
    depth = visibility(project(layers, view, RenderSettings()), view, RenderSettings())
    assert_allclose(depth.margin, identity_margin, rtol=1e-3)
    assert (depth.depth_margin > 1e6).all()
    alone = render(layers.take([0]), view, epsilon=0.0)
    assert (alone["margin"] > 1e6).all()  # the depth test of the front splat is no decision


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
    """A disc 2^-10 from edge-on nearly turns, and nearly counts as edge-on, on its line of pixels only."""
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
    """Magnified float32 noise flips only decisions with a margin of the noise's size."""
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
            # The margin is small at every pixel that a turned splat touches.
            before, after = (project(s, view, chosen) for s in (splats, noisy))
            turned = (before.culled != after.culled) | ((before.normal_eye * after.normal_eye).sum(axis=1) < 0)
            for k in np.flatnonzero(turned):
                alone = oracle.render(splats.take([k]), view, dataclasses.replace(chosen, facing="keep"))
                assert (image["margin"][alone["count"] > 0] < NOISE_MARGIN * NOISE_UNITS).all()
    near, ever_flipped = np.array(near), np.array(ever_flipped)
    assert np.count_nonzero(ever_flipped) >= 5
    assert np.count_nonzero(ever_flipped) > 0.05 * np.count_nonzero(near)  # small margins are not too common


def float32_disc(s, f, center, t_u, t_v):
    """Return den - |(u, v)| den and z of the ray s, in float32 relative to the projected center."""
    c, t_u, t_v, f = (np.float32(value) for value in (center, t_u, t_v, f))
    a, b, g = np.cross(t_v, c), np.cross(c, t_u), np.cross(t_u, t_v)
    scale = f * (g @ c) / c[2]
    d = np.float32((s - center[:2] / center[2]) * float(f))
    den = np.float32(1) + g[:2] @ d / scale
    return float(den) - math.hypot(a[:2] @ d / scale, b[:2] @ d / scale), float(c[2] / den)


@pytest.mark.parametrize("aspect", [1.0, 5.0, 100.0])
def test_margin_is_in_units_of_float32_error(aspect):
    """Float32's error at a rim pixel and at a near plane is at most MARGIN_TYPICAL units, and not far below."""
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
    """Fewer than one pixel in twenty have a margin below a thousand roundings, on a sphere of overlapping splats."""
    rng = np.random.default_rng(0)
    normal = rng.normal(size=(600, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    t_u = np.cross(normal, [0.3, 0.5, 0.8])
    t_u *= 0.15 / np.linalg.norm(t_u, axis=1, keepdims=True)
    view = Camera.look_at((0, 0, 3), (0, 0, 0), width=48, height=48)
    image = oracle.render(Splats(normal, t_u, np.cross(normal, t_u)), view, RenderSettings())
    assert np.median(image["margin"]) > 1e4
    assert np.mean(image["margin"] < 1e3) < 0.05
