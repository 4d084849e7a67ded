"""The oracle's bounds and tile lists against brute force."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from helpers.oracle_cases import (
    PROJECTIONS,
    camera,
    discs,
    facing_disc,
    random_splats,
)
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from tolerances import (
    BOUNDS_RELATIVE,
)

from splatcl import RenderSettings, oracle
from splatcl.oracle.bin import bin
from splatcl.oracle.buffers import NOTHING
from splatcl.oracle.project import project

# ---- bounds and tiles


def rim_extremes(view, center, t_u, t_v, num=512):
    """Return (x_min, y_min, x_max, y_max) of a disc's projection, polished from samples of the rim."""
    angle = np.arange(num) * 2 * np.pi / num

    def raster(a):
        return view.project(center + np.cos(a)[..., None] * t_u + np.sin(a)[..., None] * t_v)[0]

    extremes = []
    for sign, axis in itertools.product((-1, 1), (0, 1)):
        best = angle[np.argmax(sign * raster(angle)[:, axis])]
        step = angle[1]
        for _ in range(4):  # Newton's method on three samples
            low, middle, high = sign * raster(best + np.array([-step, 0, step]))[:, axis]
            curvature = low - 2 * middle + high
            best += step * (low - high) / (2 * curvature) if curvature < 0 else 0.0
            step /= 8
        extremes.append(raster(np.array([best]))[0, axis])
    return np.array(extremes)


@pytest.mark.parametrize("projection", PROJECTIONS)
@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_bounds_are_the_rims_extremes(projection, seed):
    rng = np.random.default_rng(seed)
    view = camera(16, 12.0, cx=3.0, fy=9.0, near=0.01, projection=projection)
    splats = random_splats(rng, 1, size=0.5, z=(0.0, 3.0))
    row = splats.center[0], splats.tangent_u[0], splats.tangent_v[0]
    bounds = project(splats, view, RenderSettings(prefilter="none")).bounds[0]
    reach = math.hypot(row[1][2], row[2][2])
    if row[0][2] - reach > 0.05 or (projection == "orthographic" and row[0][2] > 0.05):
        expected = rim_extremes(view, *row)
        size = (expected[2:] - expected[:2]).max()
        assert_allclose(bounds, expected, atol=BOUNDS_RELATIVE * size, rtol=0)
        conic = project(splats, view, RenderSettings(footprint="conic", prefilter="none")).bounds[0]
        assert_allclose(conic, expected, atol=BOUNDS_RELATIVE * size, rtol=0)
    elif projection == "perspective" and row[0][2] - reach <= 0:
        assert_array_equal(bounds, [-np.inf, -np.inf, np.inf, np.inf])


def test_bounds_include_the_prefilter_and_exclude_invisible_splats():
    rows = [
        facing_disc(2.0, 1 / 64),  # a quarter of a pixel in radius: 16.5 +- 1 by its pre-filter
        ((0, 0, 2), (0, 1 / 64, 0), (0.25, 0, 0)),  # 16.5 +- 4 by 16.5 +- 1
        facing_disc(-2.0, 1.0),
        facing_disc(9.0, 1.0),
        ((0, 0, 2), (0, 1, 0), (0, 0, 1)),  # edge-on: the pre-filter alone
    ]
    projected = project(discs(*rows), camera(far=8.0), RenderSettings())
    assert_allclose(projected.bounds[0], [15.5, 15.5, 17.5, 17.5])
    assert_allclose(projected.bounds[1], [12.5, 15.5, 20.5, 17.5])
    assert_array_equal(projected.bounds[2:4], [NOTHING] * 2)
    assert_allclose(projected.bounds[4], [15.5, 15.5, 17.5, 17.5])
    assert_array_equal(np.isnan(projected.center_raster[:, 0]), [False, False, True, False, False])


@pytest.mark.parametrize(
    "settings_",
    [
        {},
        {"prefilter_center": "bounds"},
        {"facing": "cull"},
        {"prefilter": "none"},
        {"footprint": "affine"},
        {"method": "zwicker04", "prefilter_radius": 2.0},
    ],
)
@pytest.mark.parametrize("projection", PROJECTIONS)
def test_bounds_and_tiles_contain_every_fragment(projection, settings_):
    f = 20.0 if projection == "perspective" else 7.0
    view = camera(29, f, width=23, near=0.2, projection=projection)
    splats = random_splats(np.random.default_rng(3), 60, size=0.15)
    chosen = RenderSettings(**settings_)
    projected = project(splats, view, chosen)
    tiles = bin(projected, view, 8)
    assert len(tiles) == 4 * 3
    total = 0
    for k in range(len(splats)):
        y, x = np.nonzero(oracle.render(splats.take([k]), view, chosen)["count"])
        total += len(x)
        x_min, y_min, x_max, y_max = projected.bounds[k]
        assert ((x + 0.5 >= x_min) & (x + 0.5 <= x_max) & (y + 0.5 >= y_min) & (y + 0.5 <= y_max)).all()
        assert all(k in tiles[t] for t in np.unique(y // 8 * 3 + x // 8))
    assert total > 60
    assert all((np.diff(tile) > 0).all() for tile in tiles)


def test_a_tile_is_reached_at_its_pixel_centers():
    """The pixel centers of the 16-pixel tiles lie in [0.5, 15.5], [16.5, 31.5] and, in the last tile, at 32.5."""
    cases = [
        ((-1, 0.25), []), ((-1, 0.5), [0]), ((14.5, 15.5), [0]), ((15.5, 16.5), [0, 1]), ((15.75, 16.25), []),
        ((15.75, 16.5), [1]), ((31.5, 32.25), [1]), ((31.75, 32.25), []), ((32.25, 32.5), [2]),
        ((32.5, 33), [2]), ((32.75, 33.5), []), ((-5, 50), [0, 1, 2]), ((10, 20), [0, 1]),
    ]  # fmt: skip
    for (x_min, x_max), columns in cases:
        center, _, t_v = facing_disc(1.0, (x_max - x_min) / 64, x=(x_min + x_max) / 64)
        splats = discs((center, (0, 2.0**-5, 0), t_v))
        for turned, where in [(False, columns), (True, [3 * c for c in columns])]:
            if turned:
                view = camera(33, 32.0, cx=0.5, cy=0.0)
                splats = discs(((0, center[0], 1), (2.0**-5, 0, 0), (0, t_v[0], 0)))
            else:
                view = camera(33, 32.0, cx=0.0, cy=0.5)
            tiles = bin(project(splats, view, RenderSettings(prefilter="none")), view, 16)
            assert [k for k in range(9) if len(tiles[k])] == where, (x_min, x_max, turned)
