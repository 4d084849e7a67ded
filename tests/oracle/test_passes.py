"""The oracle's visibility, attribute and shading passes against closed forms."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from helpers.oracle_cases import (
    NONE,
    PROJECTIONS,
    camera,
    discs,
    facing_disc,
    rays,
    render,
)
from numpy.testing import assert_allclose, assert_array_equal
from tolerances import (
    ORACLE_RELATIVE,
)

from splatcl import Light, Material, oracle

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
    """Two discs of radii 1 and 2 lie about the axis, 0.1 apart; the second is tilted."""
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
    """In the middle of a facing wall, N = V = (0, 0, -1) and z = 2."""
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
    colored = tuple(dataclasses.replace(light, color=(1.0, 2.0, 0.5)) for light, *_ in cases[:2])
    image = render(splats, camera(9), lights=colored, material=material)
    expected = albedo * (0.1 + 0.7 * (1 + half) * np.array([1, 2, 0.5])) + 0.4 * (1 + half**3) * np.array([1, 2, 0.5])
    assert_allclose(image["color"][4, 4, :3], expected, rtol=ORACLE_RELATIVE)


def test_a_light_behind_the_surface_leaves_the_ambient_part():
    """N is (0.8, 0, -0.6). The mirrored light points at the eye, but N.L < 0."""
    light = Light("directional", (0.52, 0, 0.86))
    image = render(discs(((0, 0, 2), (0, 1, 0), (0.6, 0, 0.8))), camera(9), lights=(light,))
    assert_allclose(image["color"][4, 4, :3], np.float32(0.6) * 0.1, rtol=ORACLE_RELATIVE)


@pytest.mark.parametrize("projection", PROJECTIONS)
def test_headlight_and_specular_follow_the_eye(projection):
    """A perspective eye sees the wall at cos = 1 / |d| off the axis; an orthographic eye sees it straight on."""
    view = camera(9, 4.0, projection=projection)
    material = Material(ambient=0.0, diffuse=1.0, specular=1.0, shininess=5.0)
    image = render(discs(facing_disc(2.0, 9.0)), view, material=material)
    length = np.sqrt(1 + (rays(view) ** 2).sum(axis=-1)) if projection == "perspective" else np.ones((9, 9))
    r_v = 2 / length**2 - 1  # R.V of a headlight: V mirrored about N, times V
    expected = np.float32(0.6) / length + np.maximum(r_v, 0) ** 5
    assert_allclose(image["color"][..., 0], expected, rtol=1e-10)


def test_lights_are_in_world_space():
    pose = np.eye(4)
    pose[:3, :3] = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]  # the eye looks along world y, world z is up
    pose[:3, 3] = 0, 0, 2
    splats = discs(((0, 0, 0), (1, 0, 0), (0, 0, 1)))  # the normal -y points toward the eye at (0, -2, 0)
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
