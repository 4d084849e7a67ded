"""A third opinion: Mitsuba 3's `disk` under a non-uniform transform against the oracle, ray by ray."""

from __future__ import annotations

import mitsuba as mi
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from tolerances import MITSUBA_DEPTH, MITSUBA_EXCLUDED, MITSUBA_MARGIN

from splatcl import Camera, RenderSettings, Splats, oracle

SIZE = 24


@pytest.fixture(autouse=True)
def scalar_variant():
    mi.set_variant("scalar_rgb")


def random_ellipse(rng):
    """Return center and tangents in eye space, in any pose, also behind the eye, and with skewed axes too."""
    z = rng.uniform(-1.0, 4.0)
    center = np.array([*(rng.uniform(-1.0, 1.0, 2) * (abs(z) + 0.5)), z])
    frame, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    radii = np.exp(rng.uniform(np.log(0.05), np.log(2.0), 2))
    t_u, t_v = frame[0] * radii[0], frame[1] * radii[1]
    return center, t_u, t_v + rng.choice([0.0, 0.5]) * t_u


def mitsuba_depth(view, center, t_u, t_v):
    """Return the (H, W) eye-space z of the disc; +inf where missed or out of [near, far]."""
    to_world = np.eye(4)
    to_world[:3] = np.column_stack([t_u, t_v, np.cross(t_u, t_v), center])
    scene = mi.load_dict({"type": "scene", "disc": {"type": "disk", "to_world": mi.ScalarTransform4f(to_world)}})
    depth = np.full((view.height, view.width), np.inf)
    for j, i in np.ndindex(depth.shape):
        x, y = (i + 0.5 - view.cx) / view.fx, (j + 0.5 - view.cy) / view.fy
        if view.projection == "perspective":
            hit = scene.ray_intersect_preliminary(mi.Ray3f([0, 0, 0], [x, y, 1]), coherent=False)
            z = hit.t
        else:
            hit = scene.ray_intersect_preliminary(mi.Ray3f([x, y, -20], [0, 0, 1]), coherent=False)
            z = hit.t - 20
        if hit.is_valid() and view.near <= z <= view.far:
            depth[j, i] = z
    return depth


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_single_ellipses_agree_with_mitsuba(projection):
    rng = np.random.default_rng(2005)
    settings = RenderSettings(prefilter="none")
    f = (26.0, 19.0) if projection == "perspective" else (5.0, 4.0)
    view = Camera(np.eye(4), *f, 10.3, 13.1, SIZE, SIZE, near=0.3, far=3.0, projection=projection)
    num_discs, num_hits, num_excluded = 150, 0, 0
    for _ in range(num_discs):
        ellipse = random_ellipse(rng)
        image = oracle.render(Splats(*(row[None] for row in ellipse)), view, settings)
        expected = mitsuba_depth(view, *ellipse)
        clear = image["margin"] > MITSUBA_MARGIN
        num_excluded += np.count_nonzero(~clear)
        assert_array_equal(np.isfinite(image["Z"])[clear], np.isfinite(expected)[clear], str(ellipse))
        hit = clear & np.isfinite(expected)
        num_hits += np.count_nonzero(hit)
        assert_allclose(image["Z"][hit], expected[hit], rtol=MITSUBA_DEPTH, err_msg=str(ellipse))
    assert num_hits > 500
    assert num_excluded <= MITSUBA_EXCLUDED * num_discs * SIZE**2
