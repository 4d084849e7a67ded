"""Margins and envelopes from the device: they equal the host's, with the same bits in every way of working.

Each docstring names mutations of the kernels that failed the test when put in by hand.
"""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
import pytest
from helpers.envelopes import CHOICES, EVERY, REST
from helpers.paths import ROOT
from helpers.scenes import CAMERAS, SCENES
from tolerances import DEVICE_MARGIN, DEVICE_RELATIVE, SURVEY_MARGIN

from splatcl import Camera, Renderer, RenderSettings, Splats
from splatcl.errors import DeviceError
from splatcl.evidence import envelope as envelope_pass
from splatcl.evidence import margin as margin_pass
from splatcl.evidence import nearby
from splatcl.evidence.golden import check as golden
from splatcl.evidence.golden.scenes import GoldenScene
from splatcl.evidence.host import envelope, pairs
from splatcl.evidence.host import margin as host_margin
from splatcl.opencl.passes import bin as bin_pass
from splatcl.scene.settings import effective_settings

FOLDER = ROOT / "reference_images"
sys.path.append(str(FOLDER))

from reference_scenes import SCENES as REFERENCES  # noqa: E402
from scene_files import read_scene  # noqa: E402

LIGHT = ("facing_disc", "edge_on", "near_plane", "orthographic", "epsilon_along_ray", "kernel_table", "survey")
"""Reference scenes that take the host a few seconds."""


def by_both(renderer, splats, camera, settings):
    """Return the device's and the host's margins and envelopes, by name."""
    settings = effective_settings(settings, splats.oriented)
    resident = renderer.upload(splats)
    epsilon = resident.epsilon(settings)
    on_device = images(renderer, resident, camera, settings)
    names = ("margin", "margin.raw")
    on_host = dict(zip(names, host_margin.margin(splats, camera, settings, epsilon), strict=True))
    return on_device, on_host | envelope.envelope(splats, camera, settings, epsilon)


def images(renderer, resident, camera, settings, tolerance=envelope.TOLERANCE):
    """Return every image that the device adds, by name."""
    arguments = resident, camera, settings, resident.epsilon(settings)
    margin, raw = renderer.call(margin_pass.margin, *arguments)
    limits = renderer.call(envelope_pass.envelope, *arguments, tolerance)
    return {"margin": margin, "margin.raw": raw} | limits


def assert_the_same(on_device, on_host, units=DEVICE_MARGIN):
    assert list(on_device) == list(on_host)
    for name, expected in on_host.items():
        got = on_device[name]
        assert (got.dtype, got.shape) == (expected.dtype, expected.shape), name
        absolute = units if name == "margin" else DEVICE_RELATIVE
        np.testing.assert_allclose(got, expected, rtol=DEVICE_RELATIVE, atol=absolute, err_msg=name)
    for name in ("margin.raw", "Z.lo", "Z.hi"):
        np.testing.assert_array_equal(np.isinf(on_device[name]), np.isinf(on_host[name]), err_msg=name)


# ---- equal to the host's


@pytest.fixture(scope="module")
def double_renderer(renderer):
    if not nearby.has_strict_double(renderer):
        pytest.skip("the device has no double precision")
    return renderer


@pytest.mark.parametrize("scene", [s for s in golden.scenes() if s.plain], ids=lambda scene: scene.name)
def test_golden_scenes_have_the_host_s(double_renderer, scene):
    """Mutations: a facing margin of 0 under KEEP; w.high for w.low in the sum of sure weights; no `consider_screen`."""
    assert_the_same(*by_both(double_renderer, scene.splats, scene.camera, scene.settings))


@pytest.mark.parametrize("name", LIGHT)
def test_reference_scenes_have_the_host_s(double_renderer, name):
    assert name in REFERENCES
    scene = read_scene(FOLDER, name)
    units = SURVEY_MARGIN if name == "survey" else DEVICE_MARGIN
    assert_the_same(*by_both(double_renderer, scene.splats, scene.camera, scene.settings), units)


@pytest.mark.parametrize(("scene", "camera", "choices"), [*EVERY, *REST])
def test_scenes_have_the_host_s(double_renderer, scene, camera, choices):
    """Mutations: the second least depth without `most_of`; no `open` normals in keep_extremes; no kappa in the slack of
    nearby_count; no gap to the front-most splat in `decide`."""
    assert_the_same(*by_both(double_renderer, SCENES[scene](11), CAMERAS[camera], CHOICES[choices]))


def test_no_splats_have_no_uncertain_pixel(double_renderer):
    empty = np.zeros((0, 3))
    assert_the_same(*by_both(double_renderer, Splats(empty, empty, empty), CAMERAS["outside"], CHOICES["default"]))


# ---- the same bits

WAYS = {
    "lanes 1": {"lanes": 1},
    "lanes 4": {"lanes": 4},
    "a work-item per pixel": {"mapping": "pixel"},
}
BITS = ("ordinary", "near_plane", "edge_on", "orthographic", "sub_pixel_bounds", "table_nearest")


@pytest.fixture(scope="module")
def expected(double_renderer):
    found = [scene for scene in golden.scenes() if scene.name in BITS]
    assert len(found) == len(BITS)
    return [(scene, images(double_renderer, double_renderer.upload(scene.splats), *view(scene))) for scene in found]


def view(scene):
    return scene.camera, scene.settings


def assert_bits(renderer, expected):
    for scene, images_expected in expected:
        for name, image in images(renderer, renderer.upload(scene.splats), *view(scene)).items():
            np.testing.assert_array_equal(image.view("u4"), images_expected[name].view("u4"), f"{scene.name}: {name}")


@pytest.mark.parametrize("way", WAYS)
def test_lanes_and_mappings(expected, way):
    """Mutation: `lane / BLOCK_X` and `lane % BLOCK_X` exchanged in store_bounds."""
    assert_bits(Renderer(**WAYS[way]), expected)


@pytest.mark.parametrize("x", [0.0, 1 / 32, 2 / 32])
def test_an_exactly_edge_on_disc_is_near_in_its_bounds_alone(double_renderer, renderer_with, x):
    """r3 is 0 / 0 everywhere. Mutation: `in_bounds` all ones, which lets in pairs outside the bounds."""
    camera = Camera(np.eye(4), 32.0, 32.0, 16.0, 16.0, 33, 33)
    disc = Splats(np.array([[0, 0, 1.0]]), np.array([[0, 0, 2.0**-10]]), np.array([[2.0**-10, 0, 0]]))
    camera = replace(camera, cx=camera.cx + 32 * x)
    settings = RenderSettings(epsilon=0.1, prefilter="none")
    on_device, on_host = by_both(double_renderer, disc, camera, settings)
    assert_the_same(on_device, on_host)
    assert 0 < np.count_nonzero(on_device["margin"] < pairs.MAX_MARGIN) < 400
    assert_bits(renderer_with(lanes=1), [(GoldenScene("edge_on", disc, camera, settings), on_device)])


@pytest.mark.parametrize("tile", [4, pytest.param(16, marks=pytest.mark.slow)])
def test_tiles(expected, double_renderer, monkeypatch, tile):
    """Mutation: list_splats in the opposite order for every second block."""
    monkeypatch.setattr(nearby, "TILE", tile)
    assert_bits(double_renderer, expected)


@pytest.mark.parametrize("chunk", [16, 48])
def test_chunks_and_bands(expected, double_renderer, monkeypatch, chunk):
    """Mutations: no `first_entry` in pair_region_of; no `first_entry` in the bounds of `scratch`."""
    monkeypatch.setattr(bin_pass, "MIN_CHUNK", chunk)
    monkeypatch.setattr(bin_pass, "MAX_CHUNKS", 1000)
    monkeypatch.setattr(nearby, "MAX_LIST_ENTRIES", 500)
    monkeypatch.setattr(nearby, "MAX_BAND_RECORDS", {"tile": 100})
    monkeypatch.setattr(nearby, "ENTRIES_PER_ITEM", 24)
    monkeypatch.setitem(nearby.OPTIONS, "ENTRIES", 24)
    assert_bits(double_renderer, expected)


def test_our_own_division_and_square_root(expected, double_renderer, monkeypatch):
    monkeypatch.setattr(double_renderer.device.strictness, "options", lambda _: {"EXACT_DIVIDE": 0, "EXACT_SQRT": 0})
    assert_bits(double_renderer, expected[:3])


# ---- without double precision


@pytest.mark.parametrize("reason", ["no double", "wrong double", "injected flags"])
def test_the_host_computes_where_the_device_s_doubles_will_not_do(renderer, monkeypatch, reason):
    scene = golden.scenes()[0]
    resident, camera, settings = renderer.upload(scene.splats), *view(scene)

    def wrong(_):
        raise DeviceError("computes wrongly")

    if reason == "no double":
        monkeypatch.setattr(Renderer, "supports_double", False)
    elif reason == "wrong double":
        monkeypatch.setattr(renderer.device.strictness, "options", wrong)
    else:
        monkeypatch.setattr(renderer.device.strictness, "reason", lambda _: "flags")
    for module in (margin_pass, envelope_pass):
        monkeypatch.setattr(module, "nearby", None)
    found = images(renderer, resident, camera, settings, 8.0)
    epsilon = resident.epsilon(settings)
    expected = envelope.envelope(scene.splats, camera, settings, epsilon, 8.0)
    expected["margin"], expected["margin.raw"] = host_margin.margin(scene.splats, camera, settings, epsilon)
    for name, image in expected.items():
        np.testing.assert_array_equal(found[name], image)
