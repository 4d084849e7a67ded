"""Shadow maps: against the oracle, closed forms and invariants."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.device_passes import DevicePasses
from helpers.scenes import CAMERAS, EPSILON, frames, random_ellipses
from helpers.shading import make_sums
from tolerances import (
    DOUBLE_RELATIVE,
    DOUBLE_UNITS,
    MARGIN_UNITS,
    SHADOW_GAP,
    SHADOW_TEXELS,
    SHADOWED_EITHER,
    SHADOWED_SINGLE,
)

from splatcl import Camera, Frame, Light, Material, RenderSettings, Splats, oracle
from splatcl.errors import SettingsError, SplatclError
from splatcl.io.exr import read_exr
from splatcl.oracle.shadow import lookup, shadow_maps
from splatcl.oracle.supersampling import enlarged
from splatcl.scene.lights import Npr

CASTING = (
    Light("directional", (0.3, 2.0, 1.5), (1.0, 0.0, 0.0), shadow="nearest", map_size=64),
    Light("point", (1.5, 3.0, 2.0), (0.0, 1.0, 0.0), shadow="pcf", map_size=48, bias=0.05),
    Light("spot", (0.2, 0.3, 1.4), (0.0, 0.0, 1.0), (-0.2, -0.5, -1.0), 20.0, 50.0, "nearest", map_size=64),
    Light(color=(0.1, 0.1, 0.1)),
)
"""Three lights that cast shadows, each in its own color channel, and a fourth without shadow."""
SETTINGS = RenderSettings(EPSILON, lights=CASTING, facing="flip", material=Material(0.1, 0.8, 0.1, 8.0))


@pytest.mark.parametrize(
    ("camera_name", "precision"), [("off_center", "single"), ("orthographic", "single"), ("off_center", "double")]
)
def test_shadows_are_the_oracles(renderer, camera_name, precision):
    """Mutations: the bias negated in lit_at; x and y or the weights exchanged, or texels off by one, in lit_share."""
    camera, splats = CAMERAS[camera_name], random_ellipses(num=150)
    settings = replace(SETTINGS, precision=precision)
    got, want = renderer.render(splats, camera, settings), oracle.passes(splats, camera, settings, EPSILON)
    units, scale = (MARGIN_UNITS, 1.0) if precision == "single" else (DOUBLE_UNITS, 2.0**-29)
    covered = want["weight"] > 0
    sure = covered & (want["margin"] > units)
    maps = shadow_maps(splats, settings, EPSILON)
    for channel, shadow_map in enumerate(maps[:3]):
        look = lookup(shadow_map, want["P"], camera)
        certain = (look.gap > scale * SHADOW_GAP) & (look.edge > scale * SHADOW_TEXELS) & (look.margin > units)
        assert np.count_nonzero(sure & ~certain) <= SHADOWED_EITHER * np.count_nonzero(covered)
        assert 0.04 < (look.share[covered] < 0.5).mean() < 0.5
        tolerance = SHADOWED_SINGLE if precision == "single" else 10 * DOUBLE_RELATIVE
        error = np.abs(got.color - want["color"])[..., channel]
        assert error[sure & certain].max() <= tolerance
    np.testing.assert_allclose([b for b in got.metadata["shadow_bias"] if b], [m.bias for m in maps if m], rtol=1e-12)
    assert got.metadata["shadow_bias"][3] is None


@pytest.mark.parametrize(("lanes", "tile_size"), [(None, 32), (1, 16)])
def test_shadows_have_the_same_bits_for_all_tiles_and_lanes(renderer_with, lanes, tile_size):
    splats, camera, settings = random_ellipses(num=60), CAMERAS["off_center"], replace(SETTINGS, lights=CASTING[1:3])
    first, second = (
        r.render(splats, camera, settings).color for r in (renderer_with(), renderer_with(lanes, tile_size))
    )
    np.testing.assert_array_equal(first, second)


def test_a_light_whose_bias_is_large_shines_through_everything(renderer):
    """The bits equal those without shadows, and a shader without lights draws no shadow map."""
    splats, camera = random_ellipses(num=60), CAMERAS["off_center"]
    through = replace(SETTINGS, lights=tuple(replace(light, bias=1e6) for light in CASTING[:3]))
    without = replace(SETTINGS, lights=tuple(replace(light, shadow="none") for light in CASTING[:3]))
    frames = [renderer.render(splats, camera, settings) for settings in (SETTINGS, through, without)]
    np.testing.assert_array_equal(frames[1].color, frames[2].color)
    assert (frames[0].color != frames[2].color).any()
    unlit = renderer.render(splats, camera, replace(SETTINGS, shader="albedo"))
    assert "shadow_bias" not in unlit.metadata and "shadow_bias" not in frames[2].metadata


def test_a_saved_frame_tells_its_lights_and_biases(renderer, tmp_path):
    frame = renderer.render(random_ellipses(num=60), CAMERAS["off_center"], SETTINGS)
    frame.save(tmp_path / "frame.exr")
    metadata = read_exr(tmp_path / "frame.exr")[2]
    for light, saved in zip(CASTING, metadata["settings"]["lights"], strict=True):
        assert replace(light, **{k: tuple(v) if isinstance(v, list) else v for k, v in saved.items()}) == light
    assert metadata["shadow_bias"] == list(frame.metadata["shadow_bias"]) and metadata["shadow_bias"][1] == 0.05


def disc_over_ground(up):
    """Return a disc of radius 1/2 and normal +z or -z at height 1, over a ground of radius 3 and normal +z."""
    u, v = frames(np.array([[0.0, 0, 1], [0, 0, up]]))
    radius = np.array([[3.0], [0.5]])
    return Splats([[0, 0, 0], [0, 0, 1]], u * radius, v * radius, color=np.ones((2, 3)))


@pytest.mark.parametrize("shadow", ["nearest", "pcf"])
@pytest.mark.parametrize("up", [1, -1])
@pytest.mark.parametrize("kind", ["directional", "point", "spot"])
def test_the_shadow_of_a_disc_is_a_disc(renderer, kind, up, shadow):
    """The light is straight above. From a height of 5 the shadow is 5/4 as large. Either side may face the light."""
    vector, size = ((0, 0, 1), 0.5) if kind == "directional" else ((0, 0, 5), 0.625)
    reach = {"directional": 7.1, "point": 12.8, "spot": 8.4}[kind]  # the map's side on the ground
    light = Light(kind, vector, direction=(0, 0, -1), inner=30, outer=40, shadow=shadow, bias=0.1, map_size=128)
    camera = Camera.look_at((0, -4, 3), (0, 0, 0), up=(0, 0, 1), width=48, height=40)
    settings = RenderSettings(0.01, lights=(light,), material=Material(0.25, 0.5, 0.0, 1.0), facing="cull")
    frame = renderer.render(disc_over_ground(up), camera, settings)
    eye = frame["P"].astype(np.float64) - camera.eye_from_world[:3, 3]
    x, y, z = np.moveaxis(eye @ camera.eye_from_world[:3, :3], -1, 0)
    ground = (frame.color[..., 3] > 0) & (np.abs(z) < 1e-3)
    distance = np.hypot(x, y)
    near_edge = np.abs(distance - size) < 1.5 * reach / 128
    n_l = 1.0 if kind == "directional" else 5 / np.hypot(distance, 5)
    expected = 0.25 + 0.5 * np.where(distance < size, 0.0, n_l)
    sure = ground & ~near_edge & (distance < 2.5)
    assert np.count_nonzero(sure & (distance < size)) > 10 and np.count_nonzero(sure) > 300
    np.testing.assert_allclose(frame.color[..., 0][sure], np.broadcast_to(expected, z.shape)[sure], atol=1e-5)


def test_shadows_of_a_survey_are_those_at_the_origin(renderer):
    """Far coordinates cost no precision: maps lie about the bounding sphere, and lookups start in eye space."""
    move = np.array([2.0**19, -(2.0**22), 96.0])
    splats, camera, light = random_ellipses(num=60), CAMERAS["off_center"], CASTING[0]
    matrix = camera.eye_from_world.copy()
    matrix[:3, 3] -= matrix[:3, :3] @ move
    far = Splats(splats.center + move, splats.tangent_u, splats.tangent_v, splats.color)
    settings = replace(SETTINGS, lights=(replace(light, shadow="pcf", bias=0.1),))
    near_color = renderer.render(splats, camera, settings).color
    far_color = renderer.render(far, replace(camera, eye_from_world=matrix), settings).color
    different = np.abs(far_color - near_color).max(axis=-1) > 1e-3
    assert np.count_nonzero(different) <= SHADOWED_EITHER * np.count_nonzero(near_color[..., 3])


def test_lights_without_a_shadow_map_are_refused(renderer, device):
    inside = RenderSettings(lights=(Light("point", (0.1, 0.2, 0.3), shadow="pcf"),))
    with pytest.raises(
        SettingsError, match=r"point light at \(0.1, 0.2, 0.3\) cannot cast shadows within the splats' bounding sphere"
    ):
        renderer.render(random_ellipses(num=60), CAMERAS["off_center"], inside)
    with pytest.raises(SplatclError, match="cannot cast shadows: this frame has no splats; render it again"):
        DevicePasses(device, random_ellipses(num=3), CAMERAS["off_center"], SETTINGS).shade(make_sums())
    with pytest.raises(SettingsError, match="choose shading='deferred', or shadow='none'"):
        replace(SETTINGS, shading="fragment")


def test_every_shader_that_asks_for_lights_asks_for_their_shadows(renderer):
    """A user's shader sees Phong's shadows; npr agrees with the oracle."""
    camera, splats = CAMERAS["off_center"], random_ellipses(num=150)
    diffuse = replace(SETTINGS, lights=CASTING[:1], material=Material(0.0, 1.0, 0.0, 1.0))
    code = """float4 shade(const Surface s, const Scene scene) {
      const Light l = light_at(s, scene, 0);
      return (float4)(s.albedo * l.color * max(dot(s.normal, l.toward), 0.0f), 1.0f); }"""
    phong = renderer.render(splats, camera, diffuse)
    user = renderer.render(splats, camera, replace(diffuse, shader="user", user_shader=code))
    np.testing.assert_allclose(user.color, phong.color, atol=SHADOWED_SINGLE)
    settings = replace(diffuse, shader="npr", npr=Npr(tones=(0.0, 0.25, 0.5, 1.0), contour=100.0, silhouette=-1.0))
    got, want = renderer.render(splats, camera, settings), oracle.passes(splats, camera, settings, EPSILON)
    different = np.abs(got.color - want["color"]).max(axis=-1) > SHADOWED_SINGLE
    assert np.count_nonzero(different) <= SHADOWED_EITHER * np.count_nonzero(want["weight"])
    without = renderer.render(splats, camera, replace(settings, lights=(replace(CASTING[0], shadow="none"),)))
    assert np.count_nonzero((got.color != without.color).any(axis=-1)) > 20


def test_a_frame_with_its_splats_is_lit_again_with_shadows(renderer, tmp_path):
    """The bits equal those of a fresh render. A loaded frame has no splats, so it casts no shadows."""
    camera, splats = CAMERAS["off_center"], random_ellipses(num=60)
    plain = renderer.render(splats, camera, replace(SETTINGS, lights=(Light(),)))
    again = plain.shade(lights=CASTING)
    fresh = renderer.render(splats, camera, SETTINGS)
    np.testing.assert_array_equal(again.color, fresh.color)
    assert again.metadata["shadow_bias"] == fresh.metadata["shadow_bias"]
    fresh.save(tmp_path / "frame.exr")
    loaded = Frame.load(tmp_path / "frame.exr")
    assert loaded.settings.lights == CASTING
    with pytest.raises(SplatclError, match="cannot cast shadows: this frame has no splats"):
        loaded.shade(material=Material(0.5))
    np.testing.assert_array_equal(loaded.shade(lights=(Light(),)).color, plain.color)


def test_supersampled_shadows_are_those_of_the_large_image(renderer):
    """All windows share one map, so a frame of 2x2 samples is the mean of a frame twice as large."""
    splats, camera, settings = random_ellipses(num=60), CAMERAS["off_center"], SETTINGS
    large = renderer.render(splats, enlarged(camera, 2), settings).color.astype(np.float64)
    mean = large.reshape(camera.height, 2, camera.width, 2, 4).mean(axis=(1, 3))
    got = renderer.render(splats, camera, replace(settings, supersampling=2))
    np.testing.assert_allclose(got.color, mean, atol=SHADOWED_SINGLE)
    assert got.metadata["shadow_bias"][1] == 0.05
