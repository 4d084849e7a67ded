"""Supersampling: windows have the bits of one large image, and pixels are the means of the specification."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.agreement import scene
from helpers.bits import NONE, assert_same_bits
from helpers.cli_stub import run, stub
from helpers.scenes import CAMERAS, EPSILON
from tolerances import MARGIN_UNITS, SUPERSAMPLED, SUPERSAMPLED_COLOR, SUPERSAMPLED_MASKED, SUPERSAMPLED_ROUNDING

from splatcl import Camera, Frame, Material, RenderSettings, SplatclError, Splats, oracle
from splatcl.io.png import to_srgb8
from splatcl.opencl.draw import _draw_window
from splatcl.opencl.supersampling import MIN_SAMPLES, blocks, box_filtered, supersampled
from splatcl.oracle.supersampling import averaged, enlarged
from splatcl.scene.camera import MAX_SIZE

__all__ = ["stub"]  # a fixture

SETTINGS = RenderSettings(epsilon=EPSILON)
# Scene, camera, n, precision, tile size, margin, samples per window; the windows are whole rows or parts of rows.
WINDOWS = [
    ("random_ellipses", "off_center", 2, "single", 16, 0, 300),
    ("sphere", "orthographic", 3, "single", 16, 1, 600),
    ("giant", "inside", 2, "double", 16, 0, 100),
    ("near_plane", "close", 3, "single", 16, 1, 100),
    ("sub_pixel", "outside", 2, "single", 32, 0, 50),
]


def small(camera_name):
    """Return a camera that sees the middle 23 x 18 pixels of a test camera's image."""
    camera = CAMERAS[camera_name]
    return replace(camera, width=23, height=18, cx=camera.cx - 13, cy=camera.cy - 9)


def windows(renderer, splats, settings):
    """Return a function that draws a window, and a list to which it appends each window's number of pixels."""
    resident, drawn = renderer.upload(splats), []

    def render(camera, first):
        drawn.append(camera.width * camera.height)
        return _draw_window(*renderer.pass_inputs(resident, camera, settings, first), resident.epsilon(settings))

    return render, drawn


# ---- windows


@pytest.mark.parametrize(("scene_name", "camera_name", "n", "precision", "tile_size", "margin", "samples"), WINDOWS)
def test_windows_have_the_bits_of_one_large_image(
    renderer_with, scene_name, camera_name, n, precision, tile_size, margin, samples
):
    """Mutation: no first_row in ray_y, touched_by, pixels_of, visibility.cl or attributes.cl."""
    settings, camera = replace(SETTINGS, along="ray", precision=precision), small(camera_name)
    renderer = renderer_with(tile_size=tile_size)
    large = renderer.render(scene(scene_name), enlarged(camera, n), settings)
    assert (large["count"] > 0).any()
    render, drawn = windows(renderer, scene(scene_name), settings)
    got = supersampled(camera, n, render, margin, samples)
    assert len(drawn) > 5
    assert_same_bits(got, box_filtered(large, n))


def rich():
    """Return discs with clip lines, normal fields and attributes."""
    plain, rng = scene("random_ellipses"), np.random.default_rng(5)
    return Splats(
        plain.center,
        plain.tangent_u,
        plain.tangent_v,
        color=plain.color,
        normal_du=rng.normal(size=(len(plain), 3)) * 0.1,
        normal_dv=rng.normal(size=(len(plain), 3)) * 0.1,
        clip=rng.normal(size=(len(plain), 2, 3)) + np.array([0, 0, 1]),
        attributes={"heat": rng.random(len(plain)), "shininess": rng.uniform(4, 40, len(plain))},
    )


@pytest.mark.parametrize("method", ["zwicker04", "botsch04"])
def test_windows_of_other_methods(renderer, method):
    """Mutation: `column` and `row` of `vary` counted from the image instead of the window."""
    settings, camera = RenderSettings(method=method, epsilon=EPSILON), small("off_center")
    splats = rich() if method == "botsch04" else scene("random_ellipses")
    large = renderer.render(splats, enlarged(camera, 2), settings)
    render, drawn = windows(renderer, splats, settings)
    got = supersampled(camera, 2, render, samples=300)
    assert len(drawn) > 5 and (large["count"] > 0).any()
    assert ("attribute.heat" in got, "albedo" in got) == (method == "botsch04", method == "zwicker04")
    assert_same_bits(got, box_filtered(large, 2))


@pytest.mark.parametrize("camera_name", ["off_center", "orthographic"])
def test_a_render_is_the_large_image_filtered(renderer, camera_name):
    splats, camera = scene("sphere"), CAMERAS[camera_name]
    frame = renderer.render(splats, camera, replace(SETTINGS, supersampling=3))
    assert (frame.width, frame.height, frame.camera) == (camera.width, camera.height, camera)
    assert_same_bits(frame, box_filtered(renderer.render(splats, enlarged(camera, 3), SETTINGS), 3))


def test_rows_longer_than_the_largest_image(renderer):
    """300 pixels of 64 samples are 19 200 columns, more than an image may have."""
    camera = Camera.look_at((0, 0, 3), (0, 0, 0), width=300, height=1, fov_y=0.5)
    assert 64 * camera.width > MAX_SIZE
    render, drawn = windows(renderer, scene("sphere"), SETTINGS)
    wide, narrow = supersampled(camera, 64, render, samples=2**30), supersampled(camera, 64, render, samples=2**19)
    assert len(drawn) == 5 and wide["count"].any()
    assert_same_bits(wide, narrow)


@pytest.mark.parametrize("size", [(1, 1), (7, 5), (640, 3), (3, 640), (16384, 16384)])
@pytest.mark.parametrize(("n", "margin"), [(2, 0), (3, 1), (64, 1)])
def test_blocks_cover_the_image_once_and_are_bounded(size, n, margin):
    width, height = size
    camera, samples = Camera(np.eye(4), 10, 10, 0, 0, width, height), max(MIN_SAMPLES, width * height)
    area, corner = 0, (0, 0)
    for block in blocks(camera, n, margin, samples):
        assert (block.left, block.top) == corner
        across, down = block.right - block.left, block.bottom - block.top
        assert across * down * n * n <= samples
        assert max(across, down) * n + 2 * margin <= MAX_SIZE
        area += across * down
        corner = (block.right, block.top) if block.right < width else (0, block.bottom)
    assert area == width * height


def test_memory_does_not_grow_with_the_samples(renderer):
    camera = small("outside")
    for n in (4, 16):
        render, drawn = windows(renderer, scene("layers"), SETTINGS)
        supersampled(camera, n, render)
        assert max(drawn) <= MIN_SAMPLES and sum(drawn) == n * n * camera.width * camera.height


# ---- the filter


def samples_of(rng, height, width, n):
    """Return AOVs that a render could write: empty and half-covered pixels, equal depths, discs of weight 0."""
    shape = (n * height, n * width)
    covered = rng.random(shape) < np.kron(rng.choice([0, 0.5, 1], (height, width)), np.ones((n, n)))
    hit = rng.random(shape) < 0.7
    normal = rng.normal(size=(*shape, 3))
    z = np.where(hit, rng.integers(1, 4, shape), np.inf)
    aovs = {
        "color": np.dstack([rng.random((*shape, 3)), np.ones(shape)]) * covered[..., None],
        "Z": z,
        "depth.mean": np.where(covered, rng.uniform(1, 4, shape), np.inf),
        "depth.distance": np.where(covered | hit, rng.uniform(1, 4, shape), np.inf),
        "P": rng.normal(size=(*shape, 3)) * covered[..., None],
        "N": normal / np.linalg.norm(normal, axis=-1, keepdims=True) * covered[..., None],
        "albedo": rng.random((*shape, 3)) * covered[..., None],
        "attribute.heat": rng.random(shape) * covered,
        "weight": rng.uniform(0.1, 9, shape) * covered,
        "count": rng.integers(1, 9, shape) * (covered | hit),
        "particleid": np.where(hit, rng.integers(0, 5, shape), NONE),
    }
    return {name: image.astype("u4" if name in ("count", "particleid") else "f4") for name, image in aovs.items()}


@pytest.mark.parametrize("n", [1, 2, 5])
def test_pixels_are_the_oracle_s_averages(n):
    samples = samples_of(np.random.default_rng(n), 11, 13, n)
    got, want = box_filtered(samples, n), averaged(samples, n)
    assert list(got) == list(samples)
    for name, image in got.items():
        assert image.dtype == samples[name].dtype
        exact = name in ("Z", "particleid", "count")
        tolerance = 0 if exact else SUPERSAMPLED_ROUNDING
        np.testing.assert_allclose(image, want[name], rtol=tolerance, atol=tolerance, err_msg=name)


def test_a_pixel_by_hand():
    """The four samples are: empty, a disc, the pre-filter alone, and a lower splat at the disc's depth."""
    rows = {
        "color": [[0, 0, 0, 0], [0.5, 0.25, 1, 1], [1, 0, 0, 1], [0.5, 0.75, 0, 1]],
        "Z": [np.inf, 2, np.inf, 2],
        "depth.mean": [np.inf, 2, 4, 3],
        "P": [[0, 0, 0], [0, 0, 2], [0, 0, 4], [3, 0, 3]],
        "N": [[0, 0, 0], [0, 0, -1], [0, 0, -1], [0, 1.5, 0]],
        "weight": [0, 1, 0.5, 2.5],
        "count": [0, 3, 1, 0xFFFFFFFE],
        "particleid": [NONE, 9, NONE, 4],
    }
    samples = {
        name: np.array(row, "u4" if name in ("count", "particleid") else "f4").reshape(2, 2, *np.shape(row)[1:])
        for name, row in rows.items()
    }
    pixel = {name: image[0, 0].tolist() for name, image in box_filtered(samples, 2).items()}
    assert pixel["color"] == [0.5, 0.25, 0.25, 0.75]
    assert (pixel["Z"], pixel["depth.mean"], pixel["P"]) == (2, 3, [1, 0, 3])
    assert pixel["N"] == pytest.approx([0, 0.6, -0.8], abs=SUPERSAMPLED_ROUNDING)
    assert (pixel["weight"], pixel["count"], pixel["particleid"]) == (1, NONE, 4)  # the sum exceeds UINT


# ---- a frame


@pytest.mark.parametrize("camera_name", ["off_center", "orthographic"])
@pytest.mark.parametrize("scene_name", ["layers", "sphere"])
def test_pixels_agree_with_the_oracle(renderer, scene_name, camera_name):
    settings, splats, camera = replace(SETTINGS, supersampling=2), scene(scene_name), small(camera_name)
    got, want = renderer.render(splats, camera, settings), oracle.render(splats, camera, settings)
    ok = want["margin"] >= MARGIN_UNITS
    covered = want["weight"] > 0
    assert np.count_nonzero(covered) > 100
    assert np.count_nonzero(~ok & covered) <= SUPERSAMPLED_MASKED * np.count_nonzero(covered)
    for name in got:
        exact = name in ("count", "particleid")
        tolerance = 0 if exact else SUPERSAMPLED_COLOR if name == "color" else SUPERSAMPLED
        np.testing.assert_allclose(got[name][ok], want[name][ok], rtol=tolerance, atol=tolerance, err_msg=name)


def half_covered(renderer):
    """Return a frame of 4x1 pixels with a white wall over its left half."""
    wall = Splats([[-8.0, 0, 4]], [[8.0625, 0, 0]], [[0, -900.0, 0]], color=[[1.0, 1, 1]])
    camera = Camera(np.eye(4), 16, 16, 1.75, 0.5, 4, 1)
    return renderer.render(wall, camera, RenderSettings(material=Material(1, 0, 0), supersampling=4))


def test_alpha_is_coverage_and_color_is_associated(renderer):
    """The wall ends at x = 1.75 + 16 * 0.0625 / 4 = 2, after two pixels; moved by 1/2, it covers half of the third."""
    frame = half_covered(renderer)
    np.testing.assert_array_equal(frame.color[0, :, 3], [1, 1, 0, 0])
    shifted = replace(frame.camera, cx=2.25)
    color = renderer.render(frame.rendered_from[1], shifted, frame.settings).color
    np.testing.assert_array_equal(color[0, :, 3], [1, 1, 0.5, 0])
    np.testing.assert_array_equal(color[0, 2], 0.5)


def test_a_png_has_straight_alpha(renderer, tmp_path):
    import imageio.v3 as iio

    frame = half_covered(renderer)
    color = frame.color.copy()
    color[0, 0] = [0.25, 0.125, 0, 0.5]
    frame = Frame({"color": color}, frame.camera, frame.settings)
    frame.save(tmp_path / "a.png")
    pixel = iio.imread(tmp_path / "a.png")[0, 0]
    np.testing.assert_array_equal(pixel, to_srgb8(np.float32([[[0.5, 0.25, 0, 0.5]]]))[0, 0])


def test_questions_about_single_samples_are_refused(renderer):
    frame = half_covered(renderer)
    for ask in (frame.add_margin, frame.add_envelope, frame.check, lambda: frame.probe(0, 0), lambda: frame["margin"]):
        with pytest.raises(SplatclError, match=r"each pixel is a mean of 16 samples, .*; render with supersampling=1"):
            ask()


@pytest.mark.parametrize("option", ["--check", "--margin", "--envelope"])
def test_the_command_line_refuses_before_it_renders(stub, capsys, option):
    status, _, err = run(capsys, f"render s.ply -o o.exr --supersampling 3 {option}")
    assert (status, stub.calls) == (2, []) and len(err) == 1
    assert err[0].endswith("--check, --margin and --envelope need one sample per pixel; leave out --supersampling")
    status, _, err = run(capsys, "render s.ply -o o.exr --supersampling 3")
    assert (status, err, stub.calls[0][2].supersampling) == (0, [], 3)
