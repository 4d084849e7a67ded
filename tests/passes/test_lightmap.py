"""The light map: equal to the oracle's, close to Phong, with the same bits for all lanes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.scenes import CAMERAS, EPSILON, random_ellipses, sphere
from helpers.shading import both, make_sums
from tolerances import LIGHTMAP_PHONG, LIGHTMAP_SINGLE, SHADED_DOUBLE, SPECULAR_EDGE

from splatcl import Light, Material, RenderSettings
from splatcl.errors import SettingsError

TWO = (Light("directional", (0.3, 2.0, 1.5)), Light("headlight", color=(0.3, 0.2, 0.1)))


@pytest.mark.parametrize(
    ("view", "precision"), [("off_center", "single"), ("orthographic", "single"), ("inside", "double")]
)
def test_the_lightmap_is_the_oracles(device, view, precision):
    """Mutations: x and y exchanged in `fold`; samples off by one in looked_up; diffuse light in place of specular."""
    settings = RenderSettings(lights=TWO, shader="lightmap", precision=precision)
    tolerance = LIGHTMAP_SINGLE if precision == "single" else 10 * SHADED_DOUBLE
    for material in (Material(0.1, 0.5, 0.5, 8.0), Material(0.0, 1.0, 1.0, 0.0)):
        got, want = both(device, CAMERAS[view], replace(settings, material=material), make_sums(3))
        edge = SPECULAR_EDGE if material.shininess == 0 else 0.0  # shininess 0: the highlight jumps at the horizon
        error = np.abs(got["color"] - want["color"])
        assert np.count_nonzero(error > tolerance) <= (0 if not edge else 0.01 * error.size)
        assert np.ptp(got["color"][..., :3]) > 0.1


def test_the_lightmap_is_nearly_phong(renderer):
    """The lights are directions. Phong alone cuts off a highlight whose light is behind the surface."""
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
        with pytest.raises(
            SettingsError,
            match="shader='lightmap' cannot have shadows or lights with a position: it reads light by direction alone",
        ):
            RenderSettings(lights=(light,), shader="lightmap")
    splats = replace(random_ellipses(num=3), attributes={"shininess": np.ones(3)})
    with pytest.raises(SettingsError, match="one shininess"):
        renderer.render(splats, CAMERAS["off_center"], RenderSettings(shader="lightmap"))
