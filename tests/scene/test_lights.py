"""Spot lights, the light map, environments, and lights on the command line."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.cli_stub import run, stub
from helpers.shading import one_disc
from tolerances import ENVIRONMENT

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
    """A spot at the eye lights a wall fully up to `inner`, not beyond 20 degrees, linearly in the cosine between."""
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
        (Light("lamp"), "kind 'lamp' must be one of headlight, directional, point, spot"),
        (Light("spot"), "a spot light needs a direction"),
        (Light("spot", direction=(0, 1)), "a light's direction .* must be three numbers"),
        (Light("spot", direction=(0, 0, 1), inner=50, outer=40), "inner 50 must not exceed its outer 40"),
        (Light(outer=90), "a light's outer 90.0 must be between 0.1 and 89"),
        (Light(shadow="soft"), "shadow 'soft' must be one of none, nearest, pcf"),
        (Light("point", bias=-1), "a light's bias -1.0 must be between"),
        (Light("point", map_size=64.5), "a light's map_size 64.5 must be a whole number"),
        (Light("point", map_size=9000), "a light's map_size 9000.0 must be between 16 and 8192"),
        (Light(shadow="pcf"), "a headlight has no visible shadows: it shines from the eye; choose shadow='none'"),
    ],
)
def test_bad_lights(light, message):
    with pytest.raises(SettingsError, match=message):
        RenderSettings(lights=(light,))


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
def test_directions_of_an_environment(place, up, toward):
    """The image's middle is +z, a quarter to its right is -x, the first row is up."""
    image = np.zeros((16, 32, 3))
    image[place] = 1, 2, 3
    (light,) = environment_lights(image, up=up)
    assert np.dot(light.vector, toward) > 0.99
    np.testing.assert_allclose(light.color, light.color[0] * np.array([1, 2, 3]))


@pytest.mark.parametrize(
    ("image", "options", "message"),
    [
        (np.ones((4, 8)), {}, r"must be \(H, W, 3\), not \(4, 8\)"),
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
        ("kind", "--light kind: 'kind' must be NAME=VALUE"),
        ("knd=spot", "a light has no 'knd'; it has kind, vector"),
        ("kind=spott", "kind 'spott' must be one of headlight, directional, point, spot"),
        ("vector=0:2", "vector '0:2' must be three numbers such as 0:1.5:2"),
        ("color=1:1:red", "color '1:1:red' must be three numbers"),
        ("inner=x", "inner 'x' must be a number"),
        ("kind=point,kind=point", "kind appears twice; give it once"),
        ("kind=spot", "--light kind=spot: a spot light needs a direction"),
        (
            "kind=point --shader lightmap",
            "--shader lightmap cannot have shadows or lights with a position: it reads light by direction",
        ),
    ],
)
def test_mistaken_lights_are_one_line(stub, capsys, text, message):
    status, _, err = run(capsys, f"render s.ply --png o.png --light {text}")
    assert status == MISTAKE and len(err) == 1 and message in err[0] and stub.calls == []
