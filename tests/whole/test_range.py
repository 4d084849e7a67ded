"""The range of sizes: a scene of any size has the oracle's image, or is refused with a reason."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers import scenes
from helpers.paths import ROOT

from splatcl import Camera, RenderSettings, Splats, oracle
from splatcl.errors import InvalidSplatsError
from splatcl.scene.splats import MAX_AREA, MIN_AREA

RADIUS = 0.2
"""Radius of the discs of `scenes.sphere` without a scale."""
METHODS = {"default": {}, "zwicker04": {"method": "zwicker04"}, "affine": {"footprint": "affine"}}


def scaled(size):
    """Return a sphere of discs with radius `size`, and a camera that sees it whole."""
    plain, scale = scenes.sphere(), size / RADIUS
    arrays = (scale * getattr(plain, name).astype(np.float64) for name in ("center", "tangent_u", "tangent_v"))
    camera = Camera.look_at((0, 0, -3 * scale), (0, 0, 0), width=33, height=33, near=1e-3 * scale)
    return Splats(*arrays, plain.color), camera


@pytest.mark.parametrize(
    "method", [pytest.param(name, marks=[] if name == "default" else pytest.mark.slow) for name in METHODS]
)
@pytest.mark.parametrize("size", [3.3e-8, 1e-7, 1e-3, 1e9, 3.1e9])
def test_a_scene_of_any_size_has_the_oracles_image(renderer, size, method):
    splats, camera = scaled(size)
    settings = RenderSettings(**METHODS[method])
    got, want = renderer.render(splats, camera, settings), oracle.render(splats, camera, settings)
    assert (want["count"] > 0).sum() > 500
    np.testing.assert_array_equal(got["weight"] > 0, want["weight"] > 0)
    for name in ("color", "N"):
        np.testing.assert_allclose(got[name], want[name], atol=1e-5)


@pytest.mark.parametrize(("size", "bound"), [(1e-8, "below 1e-15"), (8e9, "above 1e19"), (1e12, "above 1e19")])
def test_a_scene_beyond_the_range_is_refused(size, bound):
    with pytest.raises(InvalidSplatsError, match=rf"^400 of 400 splats .400 with an area .t_u x t_v. {bound}; .*$"):
        scaled(size)


def test_the_circle_of_a_long_ellipse_may_be_beyond_the_range(renderer):
    splats, camera = scaled(1e9)
    long = replace(splats, tangent_u=100 * splats.tangent_u, tangent_v=splats.tangent_v / 100)
    assert renderer.render(long, camera)["count"].any()
    with pytest.raises(InvalidSplatsError, match=r"400 with an area .* above 1e19"):
        renderer.render(long, camera, RenderSettings(circular=True))


def test_the_specification_has_the_range():
    text = (ROOT / "docs" / "specification.md").read_text()
    assert f"{MIN_AREA:.0e} <= |t_u x t_v| <= {MAX_AREA:.0e}".replace("e+", "e") in text
    assert (
        f"between {np.sqrt(MIN_AREA):.1e} and {np.sqrt(MAX_AREA) - 5e7:.1e}".replace("e-0", "e-").replace("e+0", "e")
        in text
    )
