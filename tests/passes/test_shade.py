"""Resolving and shading against the oracle, from invented G-buffers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.scenes import CAMERAS
from helpers.shading import SHAPE, TOLERANCE, both, make_sums, one_disc
from tolerances import SPECULAR_EDGE

from splatcl import Camera, Light, Material, RenderSettings, Splats

VIEWS = ["off_center", "orthographic", "inside"]
LIGHTS = {
    "headlight": (Light(),),
    "directional": (Light("directional", (0.3, 2.0, 1.5)),),
    "point": (Light("point", (0.5, 1.0, 2.5), (0.9, 0.5, 0.2)),),
    "three": (
        Light("point", (-0.5, 0.2, 2.0), (0.5, 0.5, 0.1)),
        Light("directional", (-1.0, 0.5, 0.5), (0.0, 0.3, 0.9)),
        Light("headlight", color=(0.2, 0.2, 0.2)),
    ),
    "spot": (Light("spot", (0.5, 1.0, 2.5), (0.9, 0.5, 0.2), direction=(-0.1, -0.4, -1.0), inner=15.0, outer=40.0),),
    "none": (),
}


def to_lights(want, camera, settings):
    """Yield N.L of every light at every pixel. The specular term jumps where N.L changes its sign."""
    for light in settings.lights:
        vector = camera.eye_from_world[:3, :3] @ light.vector
        if light.has_place:
            vector = vector + camera.eye_from_world[:3, 3] - want["P"]
        elif light.kind == "headlight":
            vector = -want["P"] if camera.projection == "perspective" else np.array([0, 0, -1.0])
        length = np.linalg.norm(np.broadcast_to(vector, want["P"].shape), axis=-1)
        yield (want["N"] * vector).sum(axis=-1) / np.where(length > 0, length, 1)


@pytest.mark.parametrize("precision", ["single", "double"])
@pytest.mark.parametrize("camera_name", VIEWS)
def test_resolved_aovs(device, camera_name, precision):
    sums = make_sums()
    got, want = both(device, CAMERAS[camera_name], RenderSettings(precision=precision), sums)
    for name in ("P", "N", "albedo", "depth.mean", "depth.distance"):
        np.testing.assert_allclose(
            got[name], want[name], rtol=TOLERANCE[precision], atol=TOLERANCE[precision], err_msg=name
        )
    empty = sums["weight_sum"] == 0
    assert empty.any() and not any(got[name][empty].any() for name in ("P", "N", "albedo", "color"))
    assert np.isinf(got["depth.mean"][empty]).all()
    np.testing.assert_array_equal(np.isinf(got["depth.distance"]), empty & np.isinf(sums["depth"]))
    np.testing.assert_array_equal(got["color"][..., 3], np.where(empty, 0, 1))
    # A pixel with pre-filter fragments alone takes its position from the mean depth.
    only = np.isinf(sums["depth"]) & ~empty
    np.testing.assert_array_equal(got["P"][only][:, 2], got["depth.mean"][only])
    np.testing.assert_array_equal(got["P"][~only & ~empty][:, 2], sums["depth"][~only & ~empty])
    assert not got["N"][0, :3].any()


@pytest.mark.parametrize("precision", ["single", "double"])
@pytest.mark.parametrize("camera_name", VIEWS)
@pytest.mark.parametrize("lights", LIGHTS)
def test_phong(device, camera_name, lights, precision):
    settings = RenderSettings(lights=LIGHTS[lights], precision=precision)
    for material in (Material(), Material(0.0, 0.3, 0.9, 4.0), Material(0.2, 0.5, 0.5, 200.0), Material(shininess=0)):
        settings, camera = replace(settings, material=material), CAMERAS[camera_name]
        got, want = both(device, camera, settings, make_sums(1))
        edges = [np.abs(n_l) < SPECULAR_EDGE for n_l in to_lights(want, camera, settings)]
        sure = ~np.any([np.zeros(SHAPE, bool), *edges], axis=0)
        assert np.count_nonzero(~sure & (want["color"][..., 3] > 0)) < 0.005 * sure.size
        tolerance = TOLERANCE[precision] * max(1.0, material.shininess)
        np.testing.assert_allclose(got["color"][sure], want["color"][sure], rtol=0, atol=tolerance)
        if lights != "none" and material.specular:
            assert np.ptp(got["color"][..., :3]) > 0.1


@pytest.mark.parametrize("shader", ["albedo", "normal"])
@pytest.mark.parametrize("precision", ["single", "double"])
@pytest.mark.parametrize("camera_name", VIEWS)
def test_unlit_shaders(device, camera_name, precision, shader):
    settings = RenderSettings(shader=shader, precision=precision)
    got, want = both(device, CAMERAS[camera_name], settings, make_sums(2))
    np.testing.assert_allclose(got["color"], want["color"], rtol=0, atol=TOLERANCE[precision])
    if shader == "albedo":
        np.testing.assert_array_equal(got["color"][..., :3], got["albedo"])


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_phong_by_hand(renderer, projection):
    """N.L, R.V and their coefficients are known at the pixel on the axis."""
    camera = Camera(np.eye(4), 16, 16, 8.5, 8.5, 17, 17, near=0.1, projection=projection)
    material = Material(ambient=0.125, diffuse=0.5, specular=0.25, shininess=2.0)
    albedo = np.array([0.5, 0.25, 1.0])
    # The normal points at the eye and the light is 60 degrees off, so N.L = R.V = 1/2.
    tilted = Light("directional", (0.0, np.sqrt(3) / 2, -0.5), (1.0, 0.5, 0.25))
    beside = Light("point", (0.0, 2 * np.sqrt(3), 2.0), (1.0, 0.5, 0.25))
    head, behind = Light(), Light("directional", (0.0, 0.1, 1.0))
    half = albedo * 0.125 + (albedo * 0.5 * 0.5 + 0.25 * 0.25) * (1.0, 0.5, 0.25)
    full = albedo * 0.125 + albedo * 0.5 + 0.25
    for light, expected in [(tilted, half), (beside, half), (head, full), (behind, albedo * 0.125)]:
        settings = RenderSettings(lights=(light,), material=material)
        color = renderer.render(one_disc((0, 0, -1)), camera, settings).color[8, 8]
        np.testing.assert_allclose(color, [*expected, 1], atol=3e-7)


def test_a_back_face_is_dark_unless_flipped(renderer):
    camera = Camera(np.eye(4), 16, 16, 8.5, 8.5, 17, 17)
    away = one_disc((0, 0, 1), color=(1, 1, 1))
    dark, lit = (renderer.render(away, camera, RenderSettings(facing=f)).color[8, 8, 0] for f in ("keep", "flip"))
    np.testing.assert_allclose((dark, lit), (0.1, 1.0), atol=3e-7)
    unsigned = Splats(away.center, away.tangent_u, away.tangent_v, away.color, oriented=False)
    np.testing.assert_allclose(renderer.render(unsigned, camera).color[8, 8, 0], 1.0, atol=3e-7)
