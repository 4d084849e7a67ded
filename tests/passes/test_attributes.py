"""The attribute pass against the oracle: the accumulated fragments and their weights."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from helpers.agreement import assert_attributes_agree, reference, scene
from helpers.device_passes import DevicePasses
from helpers.scenes import CAMERAS, EPSILON, SIZE, VIEWS, frames, log_uniform, make

from splatcl import Camera, RenderSettings, Splats
from splatcl.opencl.device import program
from splatcl.opencl.device.strictness import Device

TABLE = {"kernel": "table", "kernel_table": (1.0, 0.9, 0.4, 0.15, 0.1)}
KERNELS = {
    "gaussian": {},
    "broad": {"cutoff": 0.5},
    "narrow": {"cutoff": 4.0},
    "flat": {"cutoff": 0.0},
    "constant": {"kernel": "constant"},
    "nearest": {**TABLE, "kernel_lookup": "nearest"},
    "linear": {**TABLE, "kernel_lookup": "linear"},
}
PREFILTERS = {
    "none": {"prefilter": "none"},
    "projected": {},
    "wide": {"prefilter_radius": 2.5},
    "bounds": {"prefilter_center": "bounds"},
}


def check(device, scene_name, camera_name, settings):
    got = DevicePasses(device, scene(scene_name), CAMERAS[camera_name], settings).raster()
    assert_attributes_agree(got, reference(scene_name, camera_name, settings), settings, scene_name)
    return got


@pytest.mark.parametrize("precision", ["single", "double"])
@pytest.mark.parametrize(("scene_name", "camera_name"), VIEWS)
def test_sums_on_every_scene(device, scene_name, camera_name, precision):
    check(device, scene_name, camera_name, RenderSettings(epsilon=EPSILON, precision=precision))


@pytest.mark.parametrize("precision", ["single", "double"])
@pytest.mark.parametrize("prefilter", PREFILTERS)
@pytest.mark.parametrize("kernel", [k for k in KERNELS if k != "nearest"])
def test_every_kernel_with_every_prefilter(device, kernel, prefilter, precision):
    settings = RenderSettings(epsilon=EPSILON, precision=precision, **KERNELS[kernel], **PREFILTERS[prefilter])
    for camera_name in ("off_center", "orthographic"):
        check(device, "random_ellipses", camera_name, settings)


@pytest.mark.parametrize("precision", ["single", "double"])
@pytest.mark.parametrize("scene_name", ["near_plane", "giant", "thin", "sub_pixel", "layers"])
def test_the_prefilter_about_the_bounds(device, scene_name, precision):
    """Discs through the eye plane have no finite bounds, so they have no pre-filter."""
    settings = RenderSettings(epsilon=EPSILON, precision=precision, **PREFILTERS["bounds"])
    for camera_name in ("close", "off_center", "orthographic"):
        check(device, scene_name, camera_name, settings)


@pytest.mark.parametrize("prefilter", PREFILTERS)
def test_a_nearest_table(device, prefilter):
    """A weight jumps where r crosses half a sample, and the oracle's margin ignores this jump."""
    settings = RenderSettings(epsilon=EPSILON, **KERNELS["nearest"], **PREFILTERS[prefilter])
    for camera_name in ("off_center", "orthographic"):
        got = DevicePasses(device, scene("random_ellipses"), CAMERAS[camera_name], settings).raster()
        want = reference("random_ellipses", camera_name, settings).gbuffer
        off = np.abs(got["weight_sum"] - want.weight_sum) > 1e-5 * want.weight_sum
        assert np.count_nonzero(off) <= 2
        np.testing.assert_array_equal(got["count"], want.count)


@pytest.mark.parametrize("precision", ["single", "double"])
@pytest.mark.parametrize(("along", "facing"), list(product(["z", "ray"], ["keep", "flip", "cull"])))
def test_every_facing_and_direction_of_epsilon(device, along, facing, precision):
    settings = RenderSettings(epsilon=0.25, along=along, facing=facing, precision=precision)
    for scene_name, camera_name in product(["sphere", "random_ellipses"], ["outside", "inside", "orthographic"]):
        check(device, scene_name, camera_name, settings)


@pytest.mark.parametrize("epsilon", [0.0, 1e-3, EPSILON, 4 * EPSILON, 100.0])
def test_every_epsilon(device, epsilon):
    settings = RenderSettings(epsilon=epsilon)
    counts = [int(check(device, "layers", c, settings)["count"].sum()) for c in ("outside", "orthographic")]
    if epsilon == 0:
        alone = check(device, "layers", "outside", replace(settings, prefilter="none"))
        np.testing.assert_array_equal(alone["count"], np.isfinite(alone["depth"]))
    assert min(counts) > 0


def test_epsilon_along_the_ray_is_shorter_along_z(device):
    """The two images differ where the ray is oblique, so the tests above would notice an ignored `along`."""
    z, ray = (
        check(device, "random_ellipses", "inside", RenderSettings(epsilon=0.25, along=along))["count"]
        for along in ("z", "ray")
    )
    assert (ray <= z).all() and np.count_nonzero(ray < z) >= 10
    ortho = [
        check(device, "random_ellipses", "orthographic", RenderSettings(epsilon=0.25, along=along))["count"]
        for along in ("z", "ray")
    ]
    np.testing.assert_array_equal(*ortho)


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("scene_name", ["random_ellipses", "thin", "edge_on", "near_plane"])
def test_more_seeds(device, scene_name, seed):
    settings = RenderSettings(epsilon=EPSILON)
    for camera_name in ("outside", "close", "orthographic"):
        got = DevicePasses(device, scene(scene_name, seed), CAMERAS[camera_name], settings).raster()
        want = reference(scene_name, camera_name, settings, seed)
        assert_attributes_agree(got, want, settings, scene_name)


SKIP, TAKE = "num += near_z[i] <= farthest;", "num += near_z[i] == near_z[i];"


def skewed(camera, seed=0, num=400):
    """Return needles with nearly parallel tangents, and a backdrop at z = 2 in front of their visible tips."""
    rng = np.random.default_rng(seed)
    normal = rng.normal(size=(num, 3)) * np.concatenate([np.ones((num, 2)), log_uniform(rng, 0.1, 100, num)], axis=1)
    radius, (u, v) = log_uniform(rng, 1e-3, 0.4, num), frames(normal)
    turned = rng.uniform(0, 2 * np.pi, (num, 1))
    u, v = (radius * (u * np.cos(turn) + v * np.sin(turn)) for turn in (turned, turned + np.pi / 2))
    v = v * log_uniform(rng, 1e-6, 1e-2, num) + u * rng.uniform(-2, 2, (num, 1))
    angle = np.arctan2(v[:, 2:], u[:, 2:])
    tip = rng.uniform(0, 1, (num, 2)) * [camera.width, camera.height] - [camera.cx, camera.cy]
    tip = tip / camera.fx * (2 if camera.projection == "perspective" else 1)
    tip = np.column_stack([tip, np.full(num, 2 + 10.0 ** rng.uniform(-5, -3))])
    center = tip + u * np.cos(angle) + v * np.sin(angle)
    backdrop = [0, 0, 2], [1, 0, 0], [0, 1, 0]
    return make(rng, *(np.vstack(rows) for rows in zip((center, u, v), backdrop, strict=True)))


def close_up(focal, projection):
    return Camera(np.eye(4), focal, focal, 25, 18, near=0.125, projection=projection, **SIZE)


@pytest.mark.parametrize(
    "choices",
    [
        {},
        pytest.param({"prefilter": "none"}, marks=pytest.mark.slow),
        pytest.param({"precision": "double"}, marks=pytest.mark.slow),
    ],
    ids=str,
)
def test_records_that_are_too_far_add_nothing(device, monkeypatch, choices):
    """Mutations in project.cl: `near_z` a thousandth of `reach` too large; `c.z - reach` in place of least_depth."""
    cases = [(scene(s), CAMERAS[c]) for s, c in VIEWS]
    for focal, projection, seed in product([1e3, 1e4, 1e5], ["perspective", "orthographic"], range(8)):
        camera = close_up(focal, projection)
        cases.append((skewed(camera, seed), camera))
    settings = RenderSettings(epsilon=0.0, **choices)
    skipping = [DevicePasses(device, *case, settings).raster() for case in cases]
    inlined = program.inline_source
    monkeypatch.setattr(program, "inline_source", lambda *a: inlined(*a).replace(SKIP, TAKE))
    other = Device()
    for case, got in zip(cases, skipping, strict=True):
        want = DevicePasses(other, *case, settings).raster()
        assert all(got[name].tobytes() == want[name].tobytes() for name in want)


def test_tangents_that_rounding_makes_parallel(renderer):
    """Such splats have no normal; the pre-filter shows them, and no AOV has a NaN.

    Mutation: a normal of 0 / 0 in oriented_normal.
    """
    rng = np.random.default_rng(0)
    u = rng.uniform(-0.1, 0.1, (500, 3)).astype("f4")
    v = (u * rng.uniform(0.5, 2, (500, 1))).astype("f4")
    splats = Splats(rng.uniform(-1, 1, (500, 3)).astype("f4"), u, v, on_invalid="drop")
    for camera in CAMERAS["off_center"], CAMERAS["orthographic"]:
        frame = renderer.render(splats, camera, RenderSettings(epsilon=10.0))
        assert not any(np.isnan(frame[name]).any() for name in frame)
        assert [check.name for check in frame.check() if not check.passed] == []
