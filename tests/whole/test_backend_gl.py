"""The OpenGL backend of examples/ against splatcl."""

from __future__ import annotations

import importlib
import os

import numpy as np
import pytest
from helpers.paths import ROOT
from helpers.scenes import near_plane, random_ellipses, sphere
from numpy.testing import assert_allclose
from tolerances import GL_CLOSE, GL_DIFFERENT, PERMUTED

import splatcl
from splatcl import Camera, Light, RenderSettings, Splats
from splatcl.errors import CameraError, DeviceError, SettingsError

SCAN = ROOT / "reference_images" / "scans" / "bunny.pts"
VIEW = Camera.look_at((0, 0, 3), (0, 0, 0), width=160, height=120)
CI = os.environ.get("CI") == "true"


@pytest.fixture(scope="module")
def backend():
    """Return the backend's module; skip the tests without OpenGL, except in CI, which installs it."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(ROOT / "examples" / "backend_gl")
        try:
            module = importlib.import_module("backend")
            module.context()
        except (ImportError, DeviceError) as error:
            if CI:
                raise
            pytest.skip(f"no OpenGL to compare with: {error}")
        yield module


def drawn(backend, splats, camera, settings):
    one = backend.Backend(splats)
    one.draw(camera, settings)
    return one.read()


def assert_agrees(image, frame):
    """Assert that nearly all covered pixels of each buffer are within GL_CLOSE."""
    covered = frame["weight"] > 0
    assert covered.any()
    allowed = GL_DIFFERENT * np.count_nonzero(covered)
    for name, pixels in image.items():
        expected = frame[name]
        assert pixels.shape == expected.shape and pixels.dtype == np.float32
        tolerance = {"rtol": GL_CLOSE, "atol": 0} if name in ("Z", "weight") else {"rtol": 0, "atol": GL_CLOSE}
        close = np.isclose(pixels, expected, **tolerance).reshape(*covered.shape, -1).all(axis=2)
        assert np.count_nonzero(~close) <= allowed, name


@pytest.mark.parametrize(
    "changed",
    [
        {},
        {"facing": "flip"},
        {"facing": "cull"},
        {"prefilter": "none"},
        {"prefilter_radius": 3.0, "cutoff": 1.0},
        {"epsilon": 0.0},
        {"epsilon": float("inf")},
        {"kernel": "constant", "shader": "albedo"},
        {"shader": "normal", "facing": "flip"},
        {"lights": (Light("point", (1, 2, 3), (1, 0.5, 0)), Light("directional", (-1, 0, 1), (0, 0, 1)))},
        {"lights": ()},
    ],
    ids=str,
)
@pytest.mark.parametrize("scene", [sphere, random_ellipses])
def test_settings_mean_the_same(backend, renderer, scene, changed):
    settings = RenderSettings(**{"epsilon": 0.03125, **changed})
    assert_agrees(drawn(backend, scene(), VIEW, settings), renderer.render(scene(), VIEW, settings))


def test_many_small_splats_agree(backend, renderer):
    splats = sphere(num=50_000)
    assert_agrees(drawn(backend, splats, VIEW, RenderSettings()), renderer.render(splats, VIEW))


def test_a_crop_of_a_scan_agrees(backend, renderer):
    """The splats have no oriented normals, and they cross the border on every side."""
    splats = splatcl.read(SCAN)
    center, radius = splats.bounding_sphere
    whole = Camera.framing((center, radius), azimuth=20, elevation=10)
    crop = Camera(whole.eye_from_world, 2.5 * whole.fx, 2.5 * whole.fy, 96.0, 64.0, 192, 128, near=whole.near)
    frame = renderer.render(splats, crop)
    border = np.pad(np.zeros((126, 190), bool), 1, constant_values=True)
    assert (frame["weight"][border] > 0).any()
    assert_agrees(drawn(backend, splats, crop, RenderSettings()), frame)


@pytest.mark.parametrize("size", [96, 600])
def test_a_splat_is_whole_though_its_center_is_outside_or_it_exceeds_a_point(backend, renderer, size):
    view = Camera.look_at((0, 0, 3), (0, 0, 0), width=size, height=size)
    assert size != 600 or size > backend.largest_point()
    splats = Splats([[-4.0, 0.1, 0], [0.5, 0, -1]], [[3.5, 0, 0.5], [0.01, 0, 0]], [[0, 2.0, 0], [0, 0.01, 0]])
    frame = renderer.render(splats, view)
    assert 0.1 < np.mean(frame["weight"] > 0) < 0.9
    assert_agrees(drawn(backend, splats, view, RenderSettings()), frame)


def test_discs_through_the_near_and_far_plane_agree(backend, renderer):
    view = Camera.look_at((0, 0, 3), (0, 0, 0), width=160, height=120, near=0.1, far=0.4)
    settings = RenderSettings(epsilon=0.03125)
    assert_agrees(drawn(backend, near_plane(), view, settings), renderer.render(near_plane(), view, settings))


def test_survey_coordinates_lose_nothing(backend):
    """Adjacent float32 numbers near 4e6 are a quarter of a meter apart."""
    place = np.array([5e5, 4e6, 100.0])
    near = sphere()
    far = Splats(near.center.astype(np.float64) + place, near.tangent_u, near.tangent_v, near.color)
    view = Camera.look_at(place + np.array([0, 0, 3]), place, width=160, height=120)
    settings = RenderSettings(epsilon=0.03125)
    assert_agrees(drawn(backend, far, view, settings), drawn(backend, near, VIEW, settings))


def test_sorting_changes_nothing(backend):
    images = []
    for sort in (False, True):
        one = backend.Backend(sphere(), sort=sort)
        one.draw(VIEW, RenderSettings())
        images.append(one.read())
    for name in images[0]:
        assert_allclose(images[0][name], images[1][name], rtol=PERMUTED, atol=PERMUTED, err_msg=name)


def test_frames_do_not_depend_on_earlier_ones(backend):
    one = backend.Backend(sphere())
    wanted = drawn(backend, sphere(), VIEW, RenderSettings())
    one.draw(Camera.look_at((0, 2, 4), (0, 0, 0), width=64, height=32), RenderSettings(facing="cull", lights=()))
    one.draw(VIEW, RenderSettings())
    for name, pixels in one.read().items():
        np.testing.assert_array_equal(pixels, wanted[name], name)


def test_no_splats_give_an_empty_image(backend):
    image = drawn(backend, sphere().take([]), VIEW, RenderSettings())
    assert np.isposinf(image["Z"]).all() and not image["color"].any() and not image["weight"].any()


@pytest.mark.parametrize(
    "changed",
    [
        {"along": "ray"},
        {"prefilter_center": "bounds"},
        {"kernel": "table", "kernel_table": (1.0, 0.0)},
        {"precision": "double"},
        {"lights": (Light("spot", direction=(0, 0, -1)),)},
    ],
    ids=str,
)
def test_unsupported_settings_are_refused(backend, changed):
    with pytest.raises(SettingsError, match=next(iter(changed))):
        backend.Backend(sphere()).draw(VIEW, RenderSettings(**changed))


def test_an_orthographic_camera_is_refused(backend):
    view = Camera.look_at((0, 0, 3), (0, 0, 0), width=160, height=120, projection="orthographic")
    with pytest.raises(CameraError, match="orthographic"):
        backend.Backend(sphere()).draw(view, RenderSettings())


def test_the_script_renders_a_scan(backend, tmp_path, capsys):
    script = importlib.import_module("render")
    script.main([str(SCAN), "-o", str(tmp_path / "bunny.png"), "--size", "96x64"])
    assert (tmp_path / "bunny.png").stat().st_size > 1000
    assert backend.Backend(sphere()).renderer_name in capsys.readouterr().out
