"""The shaders depth and npr, from sums and from AOVs: against the oracle, and by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.device_passes import DevicePasses
from helpers.scenes import CAMERAS, random_ellipses
from helpers.shading import SHAPE, TOLERANCE, expected
from tolerances import NPR_TIES, NPR_TIES_SHARE

from splatcl import Camera, Frame, Light, Npr, RenderSettings, SplatclError
from splatcl.opencl.device.strictness import Device

LIGHTS = (Light("point", (-0.5, 0.2, 2.0), (0.5, 0.9, 0.1)), Light("directional", (-1.0, 0.5, 0.5), (0.2, 0.3, 0.9)))
NPR = Npr((0.1, 0.35, 0.5, 0.75, 0.95), 0.3, 0.25, (0.25, 0.0, 0.5))


def smooth_sums(seed=0):
    """Return the sums of a wavy surface with a step, a few holes, and pixels of pre-filter fragments alone."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    z = 3 + 0.02 * x + 0.5 * (y > 20) + rng.uniform(-0.1, 0.1, SHAPE)
    weight = np.where((x < 6) | (rng.random(SHAPE) < 0.01), 0, rng.uniform(0.1, 5, SHAPE))
    normal = rng.normal(size=(*SHAPE, 3)) * (1, 1, 0.3) - (0, 0, 0.8)
    sums = {
        "depth": np.where(rng.random(SHAPE) < 0.2, np.inf, z),
        "weight_sum": weight,
        "color_sum": weight[..., None] * rng.uniform(0, 1, (*SHAPE, 3)),
        "normal_sum": weight[..., None] * normal / np.linalg.norm(normal, axis=-1, keepdims=True),
        "depth_sum": weight * z,
    }
    return {name: array.astype(np.float32) for name, array in sums.items()}


def decided(sums, camera, settings):
    """Return (H, W) whether tone and line stay under slight changes of light, contour and silhouette."""
    colors, contour = [], 4 * settings.epsilon if settings.npr.contour == "auto" else settings.npr.contour
    for sign in (-1, 1):
        lights = tuple(replace(o, color=tuple(c * (1 + sign * NPR_TIES) for c in o.color)) for o in settings.lights)
        silhouette = settings.npr.silhouette + sign * NPR_TIES
        npr = replace(settings.npr, contour=contour * (1 + sign * NPR_TIES), silhouette=silhouette)
        colors.append(expected(sums, camera, replace(settings, lights=lights, npr=npr))["color"])
    return (colors[0] == colors[1]).all(axis=-1)


@pytest.mark.parametrize(("camera_name", "precision"), [("off_center", "single"), ("orthographic", "double")])
def test_npr(device, camera_name, precision):
    camera, sums = CAMERAS[camera_name], smooth_sums()
    for npr, epsilon in ((NPR, 0.0), (replace(NPR, tones=(0.5,), contour="auto"), 0.05)):
        settings = RenderSettings(epsilon, shader="npr", npr=npr, lights=LIGHTS, precision=precision)
        got = DevicePasses(device, random_ellipses(num=3), camera, settings).shade(sums)["color"]
        want, sure = expected(sums, camera, settings)["color"], decided(sums, camera, settings)
        assert np.count_nonzero(~sure) <= NPR_TIES_SHARE * sure.size
        np.testing.assert_allclose(got[sure], want[sure], rtol=0, atol=TOLERANCE[precision])
        lines = (want[..., :3] == npr.line).all(axis=-1)
        assert 0.1 < lines[want[..., 3] > 0].mean() < 0.9


@pytest.mark.parametrize(("camera_name", "precision"), [("off_center", "single"), ("orthographic", "double")])
def test_depth(device, camera_name, precision):
    settings, camera, sums = (
        RenderSettings(0.0, shader="depth", precision=precision),
        CAMERAS[camera_name],
        smooth_sums(),
    )
    got = DevicePasses(device, random_ellipses(num=3), camera, settings).shade(sums)["color"]
    want = expected(sums, camera, settings)["color"]
    np.testing.assert_allclose(got, want, rtol=TOLERANCE[precision], atol=0)
    assert np.ptp(want[want[..., 3] > 0][:, 0]) > 0


@pytest.mark.parametrize("shader", ["phong", "npr"])
def test_aovs_give_the_bits_that_sums_give(device, shader):
    """One lane gives the same bits too; rows end within a vector here."""
    camera, sums = CAMERAS["off_center"], smooth_sums(1)
    settings = RenderSettings(0.0, shader=shader, npr=NPR, lights=LIGHTS)
    got, alone = (
        DevicePasses(queue, random_ellipses(num=3), camera, settings).shade(sums) for queue in (device, Device(lanes=1))
    )
    aovs = {name: got[name] for name in ("P", "N", "albedo")} | {"weight": sums["weight_sum"]}
    again = Frame(aovs, camera, settings, {"epsilon": 0.0}).shade()
    assert got["color"].tobytes() == again.color.tobytes() == alone["color"].tobytes()


def step(width=7, height=5):
    """Return a frame of two planes that face an orthographic camera: z = 2, and 3 from column 4; column 0 is empty."""
    camera = Camera(np.eye(4), 1, 1, width / 2, height / 2, width, height, 1, 9, "orthographic")
    z = np.where(np.arange(width) < 4, 2.0, 3.0) * np.ones((height, 1))
    position = np.stack([z * 0, z * 0, z], axis=-1)
    albedo = np.ones((height, width, 3)) * (0.5, 0.25, 1.0)
    normal = np.where(np.arange(width)[:, None] > 0, (0.0, 0.0, -1.0), 0.0) * np.ones((height, 1, 1))
    return Frame({"P": position, "N": normal, "albedo": albedo}, camera)


def test_npr_by_hand():
    """N.L is 1/2: the third of four tones. Lines lie beside the empty column and on both sides of the step."""
    light = Light("directional", (0.0, np.sqrt(3) / 2, 0.5001))  # eye space is world space: +z is away
    toward = Light("directional", (0.0, np.sqrt(3) / 2, -0.5001))
    npr = Npr((0.1, 0.2, 0.5, 1.0), contour=0.75, silhouette=0.9, line=(0.0, 0.125, 0.0))
    for lights, tone in (((toward,), 0.5), ((light,), 0.1), ((), 0.1), ((toward, toward, toward), 1.0)):
        color = step().shade(shader="npr", npr=npr, lights=lights).color
        assert not color[:, 0].any()
        np.testing.assert_allclose(color[:, [1, 3, 4]], np.tile((0.0, 0.125, 0.0, 1.0), (5, 3, 1)))
        np.testing.assert_allclose(
            color[:, [2, 5, 6]], np.tile((0.5 * tone, 0.25 * tone, tone, 1.0), (5, 3, 1)), rtol=1e-6
        )
    # A jump of exactly `contour` draws no line, nor does the edge of the image.
    flat = step().shade(shader="npr", npr=replace(npr, contour=1.0), lights=()).color
    np.testing.assert_allclose(flat[:, 2:], np.tile((0.05, 0.025, 0.1, 1.0), (5, 5, 1)), rtol=1e-6)
    # N.V is 1 everywhere, so the largest silhouette, 1, draws nothing.
    np.testing.assert_array_equal(
        step().shade(shader="npr", npr=replace(npr, contour=1.0, silhouette=1.0), lights=()).color, flat
    )


def test_depth_by_hand():
    color = step().shade(shader="depth").color
    np.testing.assert_allclose(color[2, :, 0], [0, *[7 / 8] * 3, *[6 / 8] * 3], rtol=1e-6)
    frame = step()
    seen = Frame({name: frame[name] for name in frame}, replace(frame.camera, projection="perspective"))
    np.testing.assert_allclose(seen.shade(shader="depth").color[2, :, 0], [0, *[1 / 2] * 3, *[1 / 3] * 3], rtol=1e-6)


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"tones": ()}, "npr.tones has 0 tones; give 1 to 4096"),
        ({"tones": 0.5}, "npr.tones 0.5 must be a sequence"),
        ({"tones": (0.5, "dark")}, "npr.tones 'dark' must be a number"),
        ({"contour": "none"}, "npr.contour 'none' must be a number"),
        ({"contour": -1}, "npr.contour -1.0 must be between 0.0 and"),
        ({"silhouette": float("nan")}, "npr.silhouette nan must be between -1.0 and 1.0"),
        ({"line": (0, 0)}, r"npr.line \(0.0, 0.0\) must be three numbers"),
    ],
)
def test_a_wrong_npr_is_refused(wrong, says):
    with pytest.raises(SplatclError, match=says):
        RenderSettings(npr=Npr(**wrong))


def test_the_oracle_has_no_users_shader():
    settings = RenderSettings(0.0, shader="user", user_shader="float4 shade(...)")
    with pytest.raises(SplatclError, match="the oracle cannot run a user's shader"):
        expected(smooth_sums(), CAMERAS["off_center"], settings)
