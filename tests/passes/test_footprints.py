"""Elliptic footprints: their weights, contours and boxes, from the rims of discs."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.device_passes import DevicePasses
from helpers.scenes import CAMERAS, extended
from tolerances import BOX_SLACK, MARGIN_UNITS

from splatcl import Camera, RenderSettings, Splats, oracle
from splatcl.oracle.geometry.discs import Discs
from splatcl.oracle.geometry.ellipses import Ellipses, cover
from splatcl.oracle.project import project


def one_disc(tilt=0.7, radius=(0.05, 0.02)):
    """Return a single disc at z = 2, tilted about the x axis."""
    u = np.array([[radius[0], 0.0, 0.0]])
    v = np.array([[0.0, -radius[1] * np.cos(tilt), radius[1] * np.sin(tilt)]])
    return Splats(np.array([[0.11, -0.07, 2.0]]), u, v)


def ellipse_through(points):
    """Return the center and a map of the unit circle onto the ellipse through points, by least squares."""
    mean = points.mean(axis=0)
    x, y = (points - mean).T
    a, b, c, d, e = np.linalg.lstsq(np.stack([x * x, x * y, y * y, x, y], axis=1), np.ones(len(x)), rcond=None)[0]
    q = np.array([[a, b / 2], [b / 2, c]])
    center = -np.linalg.solve(q, [d / 2, e / 2])
    value = 1 + center @ q @ center
    return center + mean, np.linalg.cholesky(np.linalg.inv(q / value))


@pytest.mark.parametrize("footprint", ["affine", "conic"])
def test_ewa_weights_are_a_convolution(renderer, footprint):
    """The expected weight is a sum over a fine grid: the projected Gaussian times the low-pass Gaussian."""
    camera = Camera(np.eye(4), 60.0, 55.0, 8.3, 7.6, 17, 15, near=0.1, far=10.0)
    precision = "double" if renderer.supports_double else "single"
    settings = RenderSettings(0.1, footprint=footprint, prefilter="ewa", cutoff=2.0, precision=precision)
    splats = one_disc()
    weight = renderer.render(splats, camera, settings)["weight"]
    angle = np.linspace(0, 2 * np.pi, 4000, endpoint=False)
    rim = splats.center + np.cos(angle)[:, None] * splats.tangent_u + np.sin(angle)[:, None] * splats.tangent_v
    rim = rim[:, :2] / rim[:, 2:] * (camera.fx, camera.fy) + (camera.cx, camera.cy)
    if footprint == "affine":  # the differential at the center, by central differences
        center = splats.center[0]
        project = lambda p: p[:2] / p[2] * (camera.fx, camera.fy) + (camera.cx, camera.cy)  # noqa: E731
        h = 1e-5
        m = np.stack([(project(center + h * t[0]) - project(center - h * t[0])) / (2 * h)
                      for t in (splats.tangent_u, splats.tangent_v)], axis=1)  # fmt: skip
        middle = project(center)
    else:  # the ellipse through the projected rim, by least squares
        middle, m = ellipse_through(rim)
    step = 0.04
    y, x = np.meshgrid(np.arange(-9, 24, step), np.arange(-9, 26, step), indexing="ij")
    w = np.linalg.solve(m, np.stack([x - middle[0], y - middle[1]]).reshape(2, -1))
    kernel = np.exp(-(settings.cutoff**2) * (w**2).sum(axis=0) / 2).reshape(x.shape)
    for row, column in ((7, 11), (5, 12), (6, 10), (4, 13)):
        px, py = column + 0.5, row + 0.5
        low_pass = np.exp(-((x - px) ** 2 + (y - py) ** 2) / 2) / (2 * np.pi)
        expected = (kernel * low_pass).sum() * step**2
        if weight[row, column]:
            np.testing.assert_allclose(weight[row, column], expected, rtol=2e-6)
    assert np.count_nonzero(weight) > 10 and weight[5, 11] > 0


def test_conic_footprint_is_the_ray_casts_at_the_contour(renderer):
    """Both are the projected disc at the cutoff contour, to rounding ([ZRB04] section 4)."""
    splats, camera = extended("random_ellipses", 9), CAMERAS["outside"]
    settings = RenderSettings(0.1, footprint="conic", prefilter="none")
    projected = project(splats, camera, settings)
    discs = Discs.of(projected, camera)
    ellipses = Ellipses.of(projected, discs, camera, settings)
    for angle in np.linspace(0, 2 * np.pi, 7):
        rim = projected.center_eye + np.cos(angle) * projected.tangent_u_eye + np.sin(angle) * projected.tangent_v_eye
        s = np.concatenate([rim[:, :2] / rim[:, 2:], np.ones((len(rim), 1))], axis=1)
        r_squared = cover(ellipses, False, camera, s).r_squared
        good = ellipses.usable & (discs.kappa < 1e3)
        np.testing.assert_allclose(r_squared[good], 1.0, atol=1e-9)
    conic = renderer.render(splats, camera, settings)
    cast = renderer.render(splats, camera, RenderSettings(0.1, prefilter="none"))
    sure = oracle.passes(splats, camera, settings, 0.1)["margin"] > MARGIN_UNITS
    np.testing.assert_array_equal(np.isfinite(conic["Z"])[sure], np.isfinite(cast["Z"])[sure])
    assert sure.mean() > 0.99


@pytest.mark.parametrize("prefilter", ["none", "ewa"])
def test_conic_boxes_are_exact(device, prefilter):
    """The record's pixels lie between the extremes of the sampled rim, or of the filtered ellipse's contour."""
    settings = RenderSettings(0.1, footprint="conic", prefilter=prefilter)
    splats, camera = extended("random_ellipses", 12), CAMERAS["outside"]
    records, _ = DevicePasses(device, splats, camera, settings).project()
    projected = project(splats, camera, settings)
    angle = np.linspace(0, 2 * np.pi, 3000, endpoint=False)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    checked = 0
    for record in records:
        i = record["id"]
        c, u, v = projected.center_eye[i], projected.tangent_u_eye[i], projected.tangent_v_eye[i]
        rim = c + circle[0][:, None] * u + circle[1][:, None] * v
        points = rim[:, :2] / rim[:, 2:] * (camera.fx, camera.fy) + (camera.cx, camera.cy)
        if prefilter == "ewa":  # add the variance of the low-pass filter to the ellipse through the points
            middle, m = ellipse_through(points)
            points = middle + (np.linalg.cholesky(m @ m.T + settings.cutoff**2 * np.eye(2)) @ circle).T
        low, high = points.min(axis=0) - 0.5, points.max(axis=0) - 0.5  # counted from the center of pixel 0
        size = np.array([camera.width, camera.height])
        first, last = np.maximum(np.ceil(low), 0), np.minimum(np.floor(high), size - 1)
        box = np.array([[record["x_min"], record["y_min"]], [record["x_max"], record["y_max"]]])
        assert (box[0] <= first).all() and (box[1] >= last).all()
        near_a_pixel = np.abs(np.stack([low, high]) - np.round([low, high])) < BOX_SLACK
        assert (near_a_pixel | (box == np.stack([first, last])))[np.stack([low > 0, high < size - 1])].all()
        checked += 1
    assert checked > 100
