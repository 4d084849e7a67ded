"""The visibility pass: the nearest disc of each pixel and its depth, against the oracle."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.agreement import assert_visibility_agrees, reference, scene
from helpers.device_passes import DevicePasses
from helpers.scenes import CAMERAS, EPSILON, SCENES, VIEWS

from splatcl import Camera, RenderSettings, Splats

NONE = 0xFFFFFFFF


@pytest.mark.parametrize("precision", ["single", "double"])
@pytest.mark.parametrize(("scene_name", "camera_name"), VIEWS)
def test_depth_and_front_splat(device, scene_name, camera_name, precision):
    settings = RenderSettings(epsilon=EPSILON, precision=precision)
    got = DevicePasses(device, scene(scene_name), CAMERAS[camera_name], settings).raster()
    assert got["depth"].dtype == ("f4" if precision == "single" else "f8")
    assert_visibility_agrees(got, reference(scene_name, camera_name, settings), settings, scene_name)


@pytest.mark.parametrize("camera_name", ["outside", "orthographic", "off_center"])
@pytest.mark.parametrize("scene_name", ["random_ellipses", "sphere"])
def test_culled_splats_hide_nothing(device, scene_name, camera_name):
    settings = RenderSettings(epsilon=EPSILON, facing="cull")
    got = DevicePasses(device, scene(scene_name), CAMERAS[camera_name], settings).raster()
    want = reference(scene_name, camera_name, settings)
    assert 0 < np.count_nonzero(want.projected.culled) < len(scene(scene_name))
    assert_visibility_agrees(got, want, settings, scene_name)
    assert not np.isin(got["particleid"], np.flatnonzero(want.projected.culled)).any()


@pytest.mark.parametrize("scene_name", SCENES)
def test_the_prefilter_takes_no_part(device, scene_name):
    a, b = (
        DevicePasses(device, scene(scene_name), CAMERAS["outside"], RenderSettings(prefilter=p)).raster()
        for p in ("min", "none")
    )
    for name in ("depth", "particleid"):
        np.testing.assert_array_equal(a[name], b[name])


def facing_discs(depths, radius=1.0):
    """Return discs that face a camera at the origin, with centers on its axis."""
    center = np.outer(depths, [0, 0, 1.0]).astype(np.float32)
    u, v = (np.tile(np.float32(radius) * np.eye(3, dtype=np.float32)[i], (len(depths), 1)) for i in (1, 0))
    return Splats(center, u, v)


def test_equal_depths_go_to_the_lower_index(device):
    camera = Camera(np.eye(4), 8, 8, 4, 4, 8, 8)
    got = DevicePasses(device, facing_discs([5, 4, 4, 6], radius=3), camera, RenderSettings()).raster()
    assert (got["particleid"][3:5, 3:5] == 1).all() and (got["depth"][3:5, 3:5] == 4).all()


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
@pytest.mark.parametrize("prefilter", ["min", "none"])
def test_near_and_far_are_inside(device, projection, prefilter):
    """Both ends of [near, far] are inside; the next float on either side is not."""
    settings = RenderSettings(prefilter=prefilter)
    for depth in (2.0, 7.0):
        for direction in (-np.inf, depth, np.inf):
            z = np.nextafter(np.float32(depth), np.float32(direction))
            camera = Camera(np.eye(4), 8, 8, 4, 4, 8, 8, near=2, far=7, projection=projection)
            got = DevicePasses(device, facing_discs([z]), camera, settings).raster()
            inside = 2 <= z <= 7
            assert (got["depth"][4, 4] == z) == inside and (got["particleid"][4, 4] == 0) == inside
            assert got["count"][4, 4] == inside
            assert inside or (np.isinf(got["depth"]).all() and (got["particleid"] == NONE).all())


def test_a_tilted_disc_is_cut_at_near_and_far(device):
    """Near and far each cut the plane z = 4 + x at a known column."""
    # The ray of column i has x/z = s = (i - 15.5) / 16, so z = 4 / (1 - s): near 3 is s = -1/3, far 8 is s = 1/2.
    splats = Splats([[0, 0, 4.0]], [[8.0, 0, 8]], [[0, -11.5, 0]])
    camera = Camera(np.eye(4), 16, 16, 16, 16, 32, 32, near=3, far=8)
    got = DevicePasses(device, splats, camera, RenderSettings(prefilter="none")).raster()
    s = (np.arange(32) - 15.5) / 16
    inside = (4 / (1 - s) >= 3) & (4 / (1 - s) <= 8)
    np.testing.assert_array_equal(np.isfinite(got["depth"][16]), inside)
    np.testing.assert_allclose(got["depth"][16, inside], 4 / (1 - s[inside]), rtol=3e-7)
