"""The benchmark's scenes: they cover the image, and resampled scenes have the same surface."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import splatcl
from splatcl.apps import sample_scenes


def test_sphere_is_covered_from_outside():
    sphere = sample_scenes.fibonacci_sphere(5000)
    assert sphere.center.dtype == sphere.color.dtype == np.float32
    np.testing.assert_allclose(np.linalg.norm(sphere.center, axis=1), 1, rtol=1e-6)
    np.testing.assert_allclose(sphere.normal, sphere.center, atol=1e-5)
    for tangent in (sphere.tangent_u, sphere.tangent_v):
        np.testing.assert_allclose(np.linalg.norm(tangent, axis=1), 0.9 * math.sqrt(4 * math.pi / 5000), rtol=1e-5)
    np.testing.assert_allclose(sphere.color, 0.5 + 0.5 * sphere.center, atol=1e-6)
    directions = np.random.default_rng(1).normal(size=(1000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    nearest = np.linalg.norm(directions[:, None] - sphere.center, axis=2).min(axis=1)
    assert nearest.max() < sphere.radius[0]


def test_shuffling_keeps_every_splat_whole():
    sphere = sample_scenes.fibonacci_sphere(500)
    mixed = sample_scenes.shuffled(sphere)
    assert not np.array_equal(mixed.center, sphere.center)
    order = np.argsort(-mixed.center[:, 2])
    for name in ("center", "tangent_u", "tangent_v", "color"):
        np.testing.assert_array_equal(getattr(mixed, name)[order], getattr(sphere, name))
    np.testing.assert_array_equal(sample_scenes.shuffled(sphere).center, mixed.center)


@pytest.mark.parametrize("num", [70, 100, 130, 1000, 1234])
def test_a_resampled_scan_is_the_same_surface(num):
    scan = replace(sample_scenes.fibonacci_sphere(100), oriented=False)
    more = sample_scenes.resampled(scan, num)
    assert len(more) == num and not more.oriented
    apart = np.linalg.norm(more.center[:, None] - scan.center, axis=2).min(axis=1)
    assert apart.max() <= scan.radius[0] * (1 + 1e-5)
    area, given = (np.pi * (s.radius**2).sum() for s in (more, scan))
    assert 0.95 * given <= area <= 2 * given
    if num == 100:
        np.testing.assert_array_equal(more.center, scan.center)
        np.testing.assert_allclose(more.radius, scan.radius)


def test_parts_of_discs_leave_no_holes(renderer):
    """A hole would show the far side."""
    scan, settings = sample_scenes.fibonacci_sphere(2000), splatcl.RenderSettings(prefilter="none", epsilon=0.0)
    parts = sample_scenes.resampled(scan, 40_000)
    camera = sample_scenes.frame_camera(scan, 128, 128)
    whole, divided = (renderer.render(s, camera, settings)["Z"] for s in (scan, parts))
    holes = np.isfinite(whole) & (divided > whole + 0.5)
    assert holes.sum() < 0.001 * np.isfinite(whole).sum()
