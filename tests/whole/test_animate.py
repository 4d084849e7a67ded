"""The example that animates a model: its pictures, and its moved discs."""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
import pytest
from helpers.paths import ROOT

import splatcl


@pytest.fixture(scope="module")
def animate():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(ROOT / "examples" / "animate")
        import animate

        yield animate
    sys.modules.pop("animate", None)


def test_it_writes_a_picture_for_each_frame(animate, tmp_path, capsys):
    scan = ROOT / "reference_images" / "scans" / "bunny.pts"
    animate.main([str(scan), "-o", str(tmp_path / "frames"), "--frames", "3", "--size", "64"])
    pictures = [path.read_bytes() for path in sorted((tmp_path / "frames").iterdir())]
    assert len(set(pictures)) == 3 and all(picture.startswith(b"\x89PNG") for picture in pictures)
    assert capsys.readouterr().out.startswith("3 frames of ")


def test_the_discs_follow_the_surface(animate):
    """Waves of a plane z = 0: tangents are those of z = h sin(k y - phase), by differences."""
    y = np.linspace(-1, 1, 41)
    center = np.column_stack([np.zeros_like(y), y, np.zeros_like(y)])
    u, v = np.tile([0.05, 0, 0], (41, 1)), np.tile([0, 0.05, 0], (41, 1))
    plane = splatcl.Splats(center, u, v)
    step = 1e-3
    ahead = replace(plane, center=center + step * np.array([0, 1, 0]))
    here, there = (animate.waved(splats, 0.7) for splats in (plane, ahead))
    slope = (there["center"] - here["center"]).astype(np.float64) / step
    assert np.ptp(slope[:, 2]) > 0.1
    np.testing.assert_allclose(here["tangent_v"], 0.05 * slope, atol=2e-4)
    np.testing.assert_array_equal(here["tangent_u"], np.float32(u))
