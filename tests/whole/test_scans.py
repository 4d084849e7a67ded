"""Real scans at small size against the oracle: equal decisions, and depth, color and normal to tolerances."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from helpers.paths import ROOT
from helpers.scenes import CAMERAS, random_ellipses
from tolerances import (
    DEPTH_RELATIVE,
    ID_UNITS,
    MARGIN_UNITS,
    MASKED_DENSE_SCAN,
    MASKED_ID_MESH,
    MASKED_SCAN,
    RESOLVED,
)

from splatcl import Camera, RenderSettings, oracle
from splatcl.io.read import read
from splatcl.oracle.buffers import NO_SPLAT
from splatcl.oracle.project import project

BUNDLED = ROOT / "reference_images" / "scans"
OWN = [BUNDLED / name for name in ("bunny.pts", "1.2-with-color.las", "cloud_bin_0_feature.pcd")]
SHARED = ROOT.parent / "shared" / "data"
SCANS = [
    *OWN,
    *(
        pytest.param(SHARED / name, marks=pytest.mark.skipif(not SHARED.is_dir(), reason="no folder of scans"))
        for name in ("laurana_3dhop.ply", "bun_zipper_res2.ply", "kitten.xyz", "oni.pwn", "sample_c.las")
    ),
]
MESHES = {"laurana_3dhop.ply", "bun_zipper_res2.ply"}
"""Scans made of triangles: several splats lie in one plane and often tie for the front."""
SETTINGS = {"default": RenderSettings(), "bare": RenderSettings(prefilter="none", along="ray")}
TILE = 16


cached_read = cache(read)


def middle_of(camera, size):
    """Return a camera that sees the middle `size` x `size` pixels of `camera`'s image."""
    x, y = (camera.width - size) // 2, (camera.height - size) // 2
    return replace(camera, cx=camera.cx - x, cy=camera.cy - y, width=size, height=size)


def oracle_by_tiles(splats, camera, settings):
    """Return `oracle.passes`, tile by tile, each with the splats whose bounds come near it, because it is brute force.

    `margin` ignores the choice of the front-most splat; `id_margin` is the margin of this choice alone.
    """
    epsilon = oracle.auto_epsilon(splats) if settings.epsilon == "auto" else settings.epsilon
    x_min, y_min, x_max, y_max = project(splats, camera, settings).bounds.T
    whole = None
    for y in range(0, camera.height, TILE):
        for x in range(0, camera.width, TILE):
            width, height = min(TILE, camera.width - x), min(TILE, camera.height - y)
            near_x = (x_max >= x - 1) & (x_min <= x + width + 1)
            near_y = (y_max >= y - 1) & (y_min <= y + height + 1)
            ids = np.flatnonzero(near_x & near_y)
            window = replace(camera, cx=camera.cx - x, cy=camera.cy - y, width=width, height=height)
            part = oracle.passes(splats.take(ids), window, settings, epsilon)
            front = np.append(ids, NO_SPLAT)  # the last stands for no splat
            part["particleid"] = front[np.minimum(part["particleid"], len(ids))]
            if whole is None:
                whole = {k: np.zeros((camera.height, camera.width, *v.shape[2:]), v.dtype) for k, v in part.items()}
            for name, array in part.items():
                whole[name][y : y + height, x : x + width] = array
    return whole


def test_the_oracle_by_tiles_is_the_oracle():
    settings, camera, splats = RenderSettings(epsilon=0.03125), CAMERAS["outside"], random_ellipses()
    tiled, whole = oracle_by_tiles(splats, camera, settings), oracle.render(splats, camera, settings)
    for name, array in whole.items():
        if name == "margin":  # a far splat has a margin too, but no small one
            small = (array < 1e3) | (tiled[name] < 1e3)
            np.testing.assert_allclose(tiled[name][small], array[small], rtol=1e-6)
        else:
            np.testing.assert_allclose(tiled[name], array, rtol=1e-9, atol=1e-12, err_msg=name)


@pytest.mark.parametrize("name", SETTINGS)
@pytest.mark.parametrize("path", SCANS, ids=lambda path: path.name)
def test_the_middle_of_a_scan(renderer, path, name):
    """96 x 96 pixels of a 512 x 512 image show splats of about a pixel and larger, as a viewer sees scans."""
    splats = cached_read(path)
    camera = middle_of(Camera.framing(splats.bounding_sphere, azimuth=25, elevation=15, width=512, height=512), 96)
    check(renderer, splats, camera, SETTINGS[name], MASKED_SCAN, MASKED_ID_MESH if path.name in MESHES else MASKED_SCAN)


@pytest.mark.parametrize("path", SCANS, ids=lambda path: path.name)
def test_a_whole_scan_in_few_pixels(renderer, path):
    """64 x 64 pixels have up to fifty fragments each, nearly all of them from the pre-filter."""
    splats = cached_read(path)
    camera = Camera.framing(splats.bounding_sphere, azimuth=25, elevation=15, width=64, height=64)
    check(renderer, splats, camera, RenderSettings(), MASKED_DENSE_SCAN, MASKED_ID_MESH)


def check(renderer, splats, camera, settings, max_masked, max_id_masked):
    frame, want = renderer.render(splats, camera, settings), oracle_by_tiles(splats, camera, settings)
    covered = want["weight"] > 0
    num_covered = np.count_nonzero(covered)
    assert num_covered > 400
    sure = want["margin"] >= MARGIN_UNITS
    id_sure = sure & (want["id_margin"] >= ID_UNITS)  # not left out by either margin
    assert np.count_nonzero(covered & ~sure) <= max_masked * num_covered
    assert np.count_nonzero(covered & ~id_sure) <= max_id_masked * num_covered

    np.testing.assert_array_equal(frame["count"][sure], want["count"][sure])
    np.testing.assert_array_equal((frame["weight"] > 0)[sure], covered[sure])
    np.testing.assert_array_equal(np.isfinite(frame["Z"])[sure], np.isfinite(want["Z"])[sure])
    np.testing.assert_array_equal(frame["particleid"][id_sure], want["particleid"][id_sure])
    hit, both = sure & np.isfinite(want["Z"]), sure & covered
    np.testing.assert_allclose(frame["Z"][hit], want["Z"][hit], rtol=DEPTH_RELATIVE)
    for name in ("albedo", "N", "color"):
        np.testing.assert_allclose(frame[name][both], want[name][both], rtol=0, atol=RESOLVED, err_msg=name)
