"""Spot lights, the light map, environments, and lights on the command line."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.cli_stub import run, stub
from helpers.scenes import CAMERAS, EPSILON, random_ellipses, sphere
from helpers.shading import both, make_sums, one_disc
from tolerances import ENVIRONMENT, LIGHTMAP_PHONG, LIGHTMAP_SINGLE, SHADED_DOUBLE, SPECULAR_EDGE

from splatcl import Camera, Light, Material, RenderSettings
from splatcl.cli import MISTAKE
from splatcl.errors import SettingsError
from splatcl.oracle.lightmap import light_sums
from splatcl.scene.lights import environment_lights

__all__ = ["stub"]  # a fixture
TWO = (Light("directional", (0.3, 2.0, 1.5)), Light("headlight", color=(0.3, 0.2, 0.1)))


# ---- spots


@pytest.mark.parametrize("inner", [10.0, 20.0])
def test_a_spot_by_hand(renderer, inner):
    """A spot at the eye lights a wall: wholly up to `inner`, not beyond 20 degrees, linear in the cosine between."""
    camera = Camera(np.eye(4), 24, 24, 16.5, 16.5, 33, 33)
    spot = Light("spot", (0, 0, 0), (1.0, 0.5, 0.0), direction=(0, 0, 3), inner=inner, outer=20)
    settings = RenderSettings(lights=(spot,), material=Material(0.125, 0.5, 0.0, 1.0))
    color = renderer.render(one_disc((0, 0, -1), (1, 1, 1)), camera, settings).color
    x, y = np.meshgrid(*[(np.arange(33) - 16) / 24] * 2)
    cosine = 1 / np.sqrt(1 + x**2 + y**2)
    low, high = np.cos(np.radians([20, inner]))
    cone = np.clip((cosine - low) / max(high - low, 1e-30), 0, 1)
    sure = (np.hypot(x, y) < 0.7) & ((high > low) | (np.abs(cosine - low) > 1e-5))
    expected = 0.125 + 0.5 * cosine[..., None] * cone[..., None] * [1, 0.5, 0]
    np.testing.assert_allclose(color[sure][:, :3], expected[sure], atol=1e-5)
    assert {0.0, 1.0} < set(cone[sure]) or inner == 20.0


@pytest.mark.parametrize(
    ("light", "message"),
    [
        (Light("lamp"), "kind 'lamp' is not one of headlight, directional, point, spot"),
        (Light("spot"), "a spot light needs a direction"),
        (Light("spot", direction=(0, 1)), "a light's direction .* is not three numbers"),
        (Light("spot", direction=(0, 0, 1), inner=50, outer=40), "inner 50 is wider than its outer 40"),
        (Light(outer=90), "a light's outer 90.0 is not between 0.1 and 89"),
        (Light(shadow="soft"), "shadow 'soft' is not one of none, nearest, pcf"),
        (Light("point", bias=-1), "a light's bias -1.0 is not between"),
        (Light("point", map_size=64.5), "a light's map_size 64.5 is not a whole number"),
        (Light("point", map_size=9000), "a light's map_size 9000.0 is not between 16 and 8192"),
        (Light(shadow="pcf"), "a headlight shines from the eye, which sees none of its shadows"),
    ],
)
def test_bad_lights(light, message):
    with pytest.raises(SettingsError, match=message):
        RenderSettings(lights=(light,))


# ---- the light map


@pytest.mark.parametrize(
    ("view", "precision"), [("off_center", "single"), ("orthographic", "single"), ("inside", "double")]
)
def test_the_lightmap_is_the_oracles(device, view, precision):
    """Mutations: folds exchanged, samples off by one, diffuse for specular."""
    settings = RenderSettings(lights=TWO, shader="lightmap", precision=precision)
    tolerance = LIGHTMAP_SINGLE if precision == "single" else 10 * SHADED_DOUBLE
    for material in (Material(0.1, 0.5, 0.5, 8.0), Material(0.0, 1.0, 1.0, 0.0)):
        got, want = both(device, CAMERAS[view], replace(settings, material=material), make_sums(3))
        edge = SPECULAR_EDGE if material.shininess == 0 else 0.0  # a light of shininess 0 begins at its horizon
        error = np.abs(got["color"] - want["color"])
        assert np.count_nonzero(error > tolerance) <= (0 if not edge else 0.01 * error.size)
        assert np.ptp(got["color"][..., :3]) > 0.1


def test_the_lightmap_is_nearly_phong(renderer):
    """Of lights that are directions; a highlight whose light is behind the surface is Phong's to cut off."""
    camera, splats = CAMERAS["orthographic"], sphere()
    for material in (Material(0.0, 1.0, 0.0, 32.0), Material(0.0, 0.0, 1.0, 32.0)):
        settings = RenderSettings(EPSILON, lights=TWO, material=material)
        exact = renderer.render(splats, camera, settings)
        looked_up = renderer.render(splats, camera, replace(settings, shader="lightmap"))
        vector = camera.eye_from_world[:3, :3] @ TWO[0].vector
        lit = (exact["N"] @ vector > 0) | (material.specular == 0)
        error = np.abs(exact.color - looked_up.color)[lit].max()
        assert error < LIGHTMAP_PHONG
        assert np.count_nonzero(lit & (exact.color[..., 3] > 0)) > 100


def test_the_lightmap_has_the_same_bits_for_all_lanes(renderer_with):
    settings = RenderSettings(EPSILON, lights=TWO, shader="lightmap")
    frames = [
        r.render(random_ellipses(num=60), CAMERAS["off_center"], settings) for r in (renderer_with(), renderer_with(1))
    ]
    np.testing.assert_array_equal(frames[0].color, frames[1].color)
    np.testing.assert_array_equal(frames[0]["N"], frames[1]["N"])


def test_the_lightmap_knows_no_place_no_shadow_and_one_shininess(renderer):
    for light in (Light("point"), Light("directional", (0, 0, 1), shadow="pcf")):
        with pytest.raises(SettingsError, match="shader='lightmap' looks light up by direction alone"):
            RenderSettings(lights=(light,), shader="lightmap")
    splats = replace(random_ellipses(num=3), attributes={"shininess": np.ones(3)})
    with pytest.raises(SettingsError, match="one shininess"):
        renderer.render(splats, CAMERAS["off_center"], RenderSettings(shader="lightmap"))


# ---- environments


def test_an_even_environment_lights_every_normal_alike():
    lights = environment_lights(np.ones((32, 64, 3)))
    assert len(lights) == 2 * 16**2
    np.testing.assert_allclose(sum(np.array(light.color) for light in lights), 4.0)  # 4 pi / pi
    normal = np.random.default_rng(0).normal(size=(50, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    camera = Camera(np.eye(4), 1, 1, 0, 0, 1, 1)
    diffuse, _ = light_sums(normal, camera, RenderSettings(lights=lights))
    np.testing.assert_allclose(diffuse, 1.0, atol=ENVIRONMENT)


@pytest.mark.parametrize(
    ("place", "up", "toward"),
    [
        ((8, 16), "y", (0, 0, 1)),
        ((8, 24), "y", (-1, 0, 0)),
        ((0, 0), "y", (0, 1, 0)),
        ((8, 16), "z", (0, -1, 0)),
        ((0, 0), "z", (0, 0, 1)),
        ((8, 24), "z", (-1, 0, 0)),
    ],
)
def test_where_an_environment_shines_from(place, up, toward):
    """The middle is +z, right of it is -x, the first row is up."""
    image = np.zeros((16, 32, 3))
    image[place] = 1, 2, 3
    (light,) = environment_lights(image, up=up)
    assert np.dot(light.vector, toward) > 0.99
    np.testing.assert_allclose(light.color, light.color[0] * np.array([1, 2, 3]))


@pytest.mark.parametrize(
    ("image", "options", "message"),
    [
        (np.ones((4, 8)), {}, r"is \(H, W, 3\), not \(4, 8\)"),
        (np.full((4, 8, 3), np.nan), {}, "numbers from 0"),
        (np.ones((24, 64, 3)), {}, "64x24 cannot be averaged to 32x16"),
        (np.ones((4, 8, 3)), {"up": "x"}, "up='y' or 'z'"),
    ],
)
def test_bad_environments(image, options, message):
    with pytest.raises(SettingsError, match=message):
        environment_lights(image, **options)


# ---- the command line


def test_lights_of_the_command_line(stub, capsys):
    spot = "kind=spot,vector=0:2:-1.5,direction=0:-1:0,color=1:.5:1,inner=5,shadow=pcf,bias=0.25,map_size=256"
    status, _, err = run(capsys, f"render s.ply --png o.png --light {spot} --light color=.1:.1:.1,bias=auto")
    assert (status, err) == (0, [])
    expected = Light("spot", (0, 2, -1.5), (1, 0.5, 1), (0, -1, 0), 5, 30, "pcf", 0.25, 256), Light(color=(0.1,) * 3)
    assert stub.calls[0][2].lights == expected and isinstance(stub.calls[0][2].lights[0].map_size, int)
    run(capsys, "render s.ply --png o.png")
    assert stub.calls[1][2].lights == (Light(),)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("kind", "--light kind: 'kind' is not NAME=VALUE"),
        ("knd=spot", "a light has no 'knd'; it has kind, vector"),
        ("kind=spott", "kind 'spott' is not one of headlight, directional, point, spot"),
        ("vector=0:2", "vector '0:2' is not three numbers such as 0:1.5:2"),
        ("color=1:1:red", "color '1:1:red' is not three numbers"),
        ("inner=x", "inner 'x' is not a number"),
        ("kind=point,kind=point", "kind is given twice"),
        ("kind=spot", "--light kind=spot: a spot light needs a direction"),
        ("kind=point --shader lightmap", "--shader lightmap looks light up by direction alone"),
    ],
)
def test_mistaken_lights_are_one_line(stub, capsys, text, message):
    status, _, err = run(capsys, f"render s.ply --png o.png --light {text}")
    assert status == MISTAKE and len(err) == 1 and message in err[0] and stub.calls == []
