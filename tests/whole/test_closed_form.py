"""The device against closed forms, which a reader can check with a pencil."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.scenes import random_ellipses
from tolerances import CONSTANT_COLOR_ULPS, DEPTH_BY_HAND, EXPONENTIAL_ULPS, WEIGHT_BY_HAND

from splatcl import Camera, RenderSettings, Splats

NONE = 0xFFFFFFFF
PLAIN = RenderSettings(epsilon=0.0, prefilter="none")


def disc(center, radius=1.0, color=None):
    """Return a disc with the normal -z, toward the eye."""
    x = np.float32(radius)
    return Splats([center], [[0, x, 0]], [[x, 0, 0]], color=color)


def together(*splats):
    return Splats(*(np.concatenate([getattr(s, k) for s in splats]) for k in ("center", "tangent_u", "tangent_v")))


def pinhole(width, height, focal, **kwargs):
    """Return a camera at the origin, along z, with the principal point in the middle of the image."""
    return Camera(np.eye(4), focal, focal, width / 2, height / 2, width, height, **kwargs)


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
@pytest.mark.parametrize("radius", [1.25, 7.25, 20.25, 100.25])
def test_area_of_a_facing_disc(renderer, radius, projection):
    """A disc of `radius` pixels about a pixel corner covers the pixels with half-integer offsets up to `radius`."""
    camera = pinhole(256, 256, 64 if projection == "perspective" else 16, projection=projection)
    offset = np.arange(-128, 128) + 0.5
    within = offset[:, None] ** 2 + offset**2 <= radius**2
    frame = renderer.render(disc((0, 0, 4), radius / 16), camera, PLAIN)
    np.testing.assert_array_equal(frame["count"], within)
    # The counting error grows more slowly than the radius (Gauss's circle problem).
    assert abs(np.count_nonzero(frame["count"]) - np.pi * radius**2) < 4 * np.sqrt(radius)


@pytest.mark.parametrize("angle", [0, 30, 60, 75])
def test_area_of_a_tilted_disc(renderer, angle):
    """An orthographic disc is an ellipse: its y axis and its area are cos(tilt) times the disc's."""
    tilt, radius = np.radians(angle), 40.25
    splats = Splats([[0, 0, 4.0]], [[0, radius * np.cos(tilt), radius * np.sin(tilt)]], [[radius, 0, 0]])
    frame = renderer.render(splats, pinhole(128, 128, 1, near=-100, projection="orthographic"), PLAIN)
    offset = np.arange(-64, 64) + 0.5
    within = (offset[:, None] / np.cos(tilt)) ** 2 + offset**2 <= radius**2
    np.testing.assert_array_equal(frame["count"], within)
    area = np.pi * radius**2 * np.cos(tilt)
    assert abs(np.count_nonzero(frame["count"]) - area) < 4 * np.sqrt(radius)


def test_depth_of_a_tilted_plane(renderer):
    """The ray with x/z = s meets the plane z = 4 + x at z = 4 / (1 - s)."""
    splats = Splats([[0, 0, 4.0]], [[40.0, 0, 40]], [[0, -40.0, 0]])
    camera = Camera(np.eye(4), 8, 8, 8.5, 8.5, 17, 17)
    frame = renderer.render(splats, camera, PLAIN)
    # Column i has s = (i - 8) / 8: 0 in column 8, 1/2 in 12, -1/2 in 4, -1 in 0. Column 16, s = 1, is parallel.
    for column, depth in [(8, 4.0), (12, 8.0), (4, 8 / 3), (0, 2.0), (14, 16.0), (15, 32.0)]:
        np.testing.assert_allclose(frame["Z"][6:11, column], depth, rtol=DEPTH_BY_HAND)
    assert np.isinf(frame["Z"][:, 16]).all()
    np.testing.assert_allclose(frame["P"][8, 12], (4, 0, 8), rtol=DEPTH_BY_HAND)
    np.testing.assert_allclose(frame["depth.distance"][8, 0], 2 * np.sqrt(2), rtol=DEPTH_BY_HAND)
    normal = np.array([1, 0, -1]) / np.sqrt(2)
    np.testing.assert_allclose(frame["N"][8, 8], normal, atol=2e-7)


def test_depth_of_a_tilted_plane_orthographic(renderer):
    """Parallel rays meet the same plane at x = (i - 8) / 2 in column i, and z = 4 + x."""
    splats = Splats([[0, 0, 4.0]], [[40.0, 0, 40]], [[0, -40.0, 0]])
    camera = Camera(np.eye(4), 2, 2, 8.5, 8.5, 17, 17, near=-100, projection="orthographic")
    frame = renderer.render(splats, camera, PLAIN)
    np.testing.assert_allclose(frame["Z"][5], 4 + (np.arange(17) - 8) / 2, rtol=DEPTH_BY_HAND, atol=1e-6)
    np.testing.assert_array_equal(frame["Z"], frame["depth.distance"])


def test_a_pixel_center_by_hand(renderer):
    """x = fx X/Z + cx with an off-center principal point; the center of pixel (i, j) is (i + 1/2, j + 1/2)."""
    camera = Camera(np.eye(4), 50, 40, 11.25, 28.5, 64, 48)
    # (0.33, -0.2, 2): x = 50 * 0.165 + 11.25 = 19.5 and y = 40 * -0.1 + 28.5 = 24.5, the center of pixel (19, 24).
    frame = renderer.render(disc((0.33, -0.2, 2.0), 0.02), camera, PLAIN)
    assert [(int(y), int(x)) for y, x in np.argwhere(frame["count"])] == [(24, 19)]
    np.testing.assert_allclose(frame["P"][24, 19], (0.33, -0.2, 2), rtol=1e-6)
    # The pixel's lower right corner is equally far from four pixels.
    frame = renderer.render(disc((0.35, -0.175, 2.0), 0.04), camera, PLAIN)
    assert {(int(y), int(x)) for y, x in np.argwhere(frame["count"])} == {(24, 19), (24, 20), (25, 19), (25, 20)}
    weights = frame["weight"][24:26, 19:21]
    np.testing.assert_allclose(weights, weights[0, 0], rtol=1e-5)


def test_the_world_is_seen_the_right_way_up(renderer):
    """The eye at +z sees world y up: a splat at +x is on the right, one at +y is above."""
    camera = Camera.look_at((0, 0, 4), (0, 0, 0), width=32, height=32)
    right, above = (renderer.render(disc(c, 0.2), camera, PLAIN)["count"] for c in ((1, 0, 0), (0, 1, 0)))
    assert right[:, 16:].any() and not right[:, :16].any()
    assert above[:16].any() and not above[16:].any()


@pytest.mark.parametrize("along", ["z", "ray"])
def test_layers_just_inside_and_just_outside_epsilon(renderer, along):
    """Facing layers are at z = 2 and 2.25: epsilon = 1/4 includes the second, one ulp of depth less does not."""
    layers = together(disc((0, 0, 2.25)), disc((0, 0, 2.0)))
    camera = Camera(np.eye(4), 8, 8, 8.5, 8.5, 17, 17)
    for epsilon, count in [(0.25, 2), (0.25 - 2**-22, 1), (0.5, 2), (0.0, 1)]:
        frame = renderer.render(layers, camera, RenderSettings(epsilon=epsilon, along=along, prefilter="none"))
        assert frame["count"][8, 8] == count and frame["Z"][8, 8] == 2 and frame["particleid"][8, 8] == 1
        assert frame["weight"][8, 8] == count


def test_epsilon_along_an_oblique_ray(renderer):
    """The ray at x/z = 3/4 is 5/4 as long as z, so the layer 1/4 behind is 5/16 behind along the ray."""
    layers = together(disc((0, 0, 2.0), 4.0), disc((0, 0, 2.25), 4.0))
    camera = Camera(np.eye(4), 8, 8, 8.5, 8.5, 17, 17)
    counts = [
        renderer.render(layers, camera, RenderSettings(epsilon=e, along=along))["count"][8, 14]
        for e, along in [(0.251, "z"), (0.249, "z"), (0.3135, "ray"), (0.3115, "ray")]
    ]
    assert counts == [2, 1, 2, 1]


@pytest.mark.parametrize(("projection", "focal"), [("perspective", 4), ("orthographic", 1)])
def test_weight_at_the_center_and_the_rim(renderer, projection, focal):
    """The weight is 1 at the center, e^-1/2 halfway, e^-2 at the rim, which belongs to the splat, and 0 beyond."""
    camera = Camera(np.eye(4), focal, focal, 8.5, 8.5, 17, 17, projection=projection)
    weight = renderer.render(disc((0, 0, 4), 4.0), camera, PLAIN)["weight"]
    assert weight[8, 8] == 1
    np.testing.assert_allclose(weight[8, [4, 12]], np.exp(-2), rtol=WEIGHT_BY_HAND)
    np.testing.assert_allclose(weight[[4, 12], 8], np.exp(-2), rtol=WEIGHT_BY_HAND)
    np.testing.assert_allclose(weight[8, [6, 10]], np.exp(-0.5), rtol=WEIGHT_BY_HAND)
    assert not weight[8, [3, 13]].any() and not weight[[3, 13], 8].any()
    for cutoff in (0.5, 1.0, 3.0, 8.0):
        settings = RenderSettings(epsilon=0.0, prefilter="none", cutoff=cutoff)
        rim = renderer.render(disc((0, 0, 4), 4.0), camera, settings)["weight"][8, 4]
        np.testing.assert_allclose(rim, np.exp(-(cutoff**2) / 2), rtol=WEIGHT_BY_HAND)


@pytest.mark.parametrize("precision", ["single", "double"])
def test_the_exponential_along_a_radius(renderer, precision):
    """w = exp(-cutoff^2 r^2 / 2) at r = k/64 tests the exponential alone, because r^2 is exact."""
    camera = Camera(np.eye(4), 1, 1, 64.5, 0.5, 129, 1, projection="orthographic")
    r_squared = (np.arange(-64, 65) / 64) ** 2
    for cutoff in (1.0, 2.0, 3.0, 5.0, 8.0):
        settings = RenderSettings(epsilon=0.0, prefilter="none", cutoff=cutoff, precision=precision)
        weight = renderer.render(disc((0, 0, 4), 64.0), camera, settings)["weight"][0]
        relative = EXPONENTIAL_ULPS * np.finfo(weight.dtype).eps
        np.testing.assert_allclose(weight, np.exp(-(cutoff**2) * r_squared / 2), rtol=relative)


def test_weights_of_a_table(renderer):
    """Samples are at r = 0, 1/2, 1. At r = 1/4 and 3/4, nearest takes the upper one and linear the mean."""
    camera = Camera(np.eye(4), 1, 1, 8.5, 8.5, 17, 17, projection="orthographic")
    table = {"kernel": "table", "kernel_table": (1.0, 0.5, 0.25), "prefilter": "none"}
    nearest, linear = (
        renderer.render(disc((0, 0, 4), 4.0), camera, RenderSettings(kernel_lookup=k, **table))["weight"]
        for k in ("nearest", "linear")
    )
    np.testing.assert_array_equal(nearest[8, 8:14], [1, 0.5, 0.5, 0.25, 0.25, 0])
    np.testing.assert_array_equal(linear[8, 8:14], [1, 0.75, 0.5, 0.375, 0.25, 0])


def test_the_prefilter_of_a_point(renderer):
    """The pre-filter of a disc of 1/100 pixel at a pixel's center reaches the four neighbors with weight e^-2."""
    camera = Camera(np.eye(4), 8, 8, 8.5, 8.5, 17, 17)
    frame = renderer.render(disc((0, 0, 4), 0.005), camera, RenderSettings(epsilon=0.0))
    cross = np.zeros((17, 17), bool)
    cross[7:10, 8] = cross[8, 7:10] = True
    np.testing.assert_array_equal(frame["count"], cross)
    assert frame["weight"][8, 8] == 1
    np.testing.assert_allclose(frame["weight"][cross & (frame["weight"] < 1)], np.exp(-2), rtol=WEIGHT_BY_HAND)
    assert np.isfinite(frame["Z"]).sum() == 1 and frame["Z"][8, 8] == 4
    np.testing.assert_allclose(frame["depth.mean"][cross], 4, rtol=1e-6)
    wide = renderer.render(disc((0, 0, 4), 0.005), camera, RenderSettings(epsilon=0.0, prefilter_radius=2.0))
    assert np.count_nonzero(wide["count"]) == 13


def test_a_constant_color_is_kept(renderer):
    """The weighted mean of any number of equal values is that value, for any weights."""
    splats, color = random_ellipses(seed=5, num=400), np.float32([0.1, 0.7, 0.3333])
    splats = Splats(splats.center * 0.5, splats.tangent_u * 3, splats.tangent_v * 3, color=np.tile(color, (400, 1)))
    camera = Camera.look_at((0, 0, 3), (0, 0, 0), width=61, height=47)
    frame = renderer.render(splats, camera, RenderSettings(epsilon=10.0, shader="albedo"))
    covered = frame["count"] > 0
    assert frame["count"].max() > 30
    ulps = np.abs(frame["albedo"][covered] - color) / np.spacing(color)
    assert ulps.max() <= CONSTANT_COLOR_ULPS
    np.testing.assert_array_equal(frame.color[covered][:, :3], frame["albedo"][covered])
    np.testing.assert_array_equal(frame.color[..., 3], covered)


@pytest.mark.parametrize("size", [(1, 1), (17, 5), (64, 64)])
@pytest.mark.parametrize("precision", ["single", "double"])
def test_no_splats_give_an_empty_frame(renderer, size, precision):
    splats = Splats(*np.zeros((3, 0, 3)))
    frame = renderer.render(splats, pinhole(*size, 8), RenderSettings(precision=precision))
    assert frame.color.shape == (size[1], size[0], 4) and not frame.color.any()
    assert np.isinf(frame["Z"]).all() and (frame["particleid"] == NONE).all()
    assert not any(frame[name].any() for name in ("weight", "count", "N", "P", "albedo"))


@pytest.mark.parametrize("size", [(1, 1), (2, 1), (1, 3), (7, 5), (8, 8), (15, 17), (33, 31), (129, 1)])
def test_a_splat_larger_than_the_image_covers_it(renderer, size):
    frame = renderer.render(disc((0, 0, 4), 1000.0), pinhole(*size, 8), PLAIN)
    assert (frame["count"] == 1).all() and (frame["particleid"] == 0).all() and (frame["Z"] == 4).all()
    assert (frame["weight"] > 0.99).all()


def test_the_eye_inside_the_scene(renderer):
    """A floor disc passes under and behind the eye; the part in front is drawn, up to the horizon."""
    floor = Splats([[0, 1.0, 0]], [[100.0, 0, 0]], [[0, 0, -100.0]])  # y is down: below the eye, through its plane
    camera = Camera(np.eye(4), 16, 16, 16.5, 16.5, 33, 33, near=0.5)
    frame = renderer.render(floor, camera, PLAIN)
    # Row j has y/z = (j - 16) / 16, so z = 16 / (j - 16) falls to 1 below the horizon (row 16).
    for row in (17, 20, 24, 32):
        np.testing.assert_allclose(frame["Z"][row, 16], 16 / (row - 16), rtol=DEPTH_BY_HAND)
    assert not frame["count"][:17].any() and frame["count"][17:].all()
    behind = renderer.render(disc((0, 0, -2), 1.0), camera, RenderSettings())
    assert not behind["count"].any()


@pytest.mark.parametrize("size", [(8192, 64), (64, 8192)])
def test_long_images(renderer, size):
    check_discs_in_the_corners(renderer, *size)


@pytest.mark.slow
def test_the_largest_promised_image(renderer):
    check_discs_in_the_corners(renderer, 8192, 8192)


def check_discs_in_the_corners(renderer, width, height):
    """Assert exact pixel counts of five discs of 10.25 pixels: one in each corner and one in the middle."""
    camera = pinhole(width, height, 1024)
    places = [(x, y) for x in (12, width - 12) for y in (12, height - 12)] + [(width // 2, height // 2)]
    offset = np.arange(-12, 12) + 0.5
    within = offset[:, None] ** 2 + offset**2 <= 10.25**2
    center = np.array([((x - width / 2) / 1024, (y - height / 2) / 1024, 1) for x, y in places])
    u, v = np.tile([[0, 10.25 / 1024, 0]], (5, 1)), np.tile([[10.25 / 1024, 0, 0]], (5, 1))
    count = renderer.render(Splats(center, u, v), camera, PLAIN)["count"]
    for x, y in places:
        np.testing.assert_array_equal(count[y - 12 : y + 12, x - 12 : x + 12], within)
    assert np.count_nonzero(count) == 5 * np.count_nonzero(within)
