"""The reference images: every AOV of every scene, bit by bit; and the comparison itself."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from helpers.image_difference import difference, differences, report, similarity
from helpers.paths import ROOT

from splatcl import Camera, Frame, RenderSettings
from splatcl.io.exr import read_exr

FOLDER = ROOT / "reference_images"
sys.path.append(str(FOLDER))

import page  # noqa: E402
import regenerate  # noqa: E402
from reference_scenes import SCENES  # noqa: E402
from scene_files import read_scene, scene_names, write_scene  # noqa: E402

ROUNDING = 1e-6
"""Difference of scenes built with another NumPy or LAPACK, relative to their size: roundings of float32 and float64."""


@pytest.fixture(params=SCENES)
def scene(request, renderer):
    scene = read_scene(FOLDER, request.param)
    if scene.settings.precision == "double" and renderer._device.info.supports["double"] == "no":
        pytest.skip("the device has no double precision")
    return request.param, scene


def test_a_scene_has_the_bits_of_its_reference_image(scene, renderer):
    name, scene = scene
    frame = renderer.render(scene.splats, scene.camera, scene.settings)
    reference, camera, _ = read_exr(FOLDER / f"{name}.exr")
    assert np.array_equal(camera.eye_from_world, scene.camera.eye_from_world)
    found = differences(frame, reference)
    if found:
        pytest.fail(report(name, frame, reference, found, ROOT / "out" / "reference_images" / name), pytrace=False)


def test_the_code_builds_the_stored_scenes():
    for name in SCENES:
        built, stored = SCENES[name](), read_scene(FOLDER, name)
        assert (built.about, built.settings, built.splats.oriented) == (
            stored.about,
            stored.settings,
            stored.splats.oriented,
        )
        for field in ("eye_from_world", "fx", "fy", "cx", "cy", "width", "height", "near", "far"):
            np.testing.assert_allclose(getattr(built.camera, field), getattr(stored.camera, field), rtol=ROUNDING)
        size = built.splats.bounding_sphere[1]
        for field in ("center", "radius", "color"):  # LAPACK chooses the sign of an estimated tangent
            np.testing.assert_allclose(
                getattr(built.splats, field), getattr(stored.splats, field), rtol=0, atol=ROUNDING * size, err_msg=name
            )


FEW = ("facing_disc", "checkerboard", "edge_on", "near_plane", "bunny")
"""Scenes that share programs."""


@pytest.mark.parametrize(
    ("scene", "tile_size"),
    [*((name, 16) for name in FEW), *(pytest.param(name, 32, marks=pytest.mark.slow) for name in SCENES)],
    indirect=["scene"],
)
def test_regenerating_twice_gives_the_same_bytes(scene, tile_size, renderer, renderer_with, tmp_path):
    name, scene = scene
    for folder, each in (("once", renderer), ("again", renderer_with(lanes=1, tile_size=tile_size))):
        (tmp_path / folder).mkdir()
        write_scene(tmp_path / folder, name, scene, each.render(scene.splats, scene.camera, scene.settings))
    files = sorted(path.name for path in (tmp_path / "once").iterdir())
    assert files == [f"{name}.{suffix}" for suffix in ("exr", "json", "npz", "png")]
    for file in files:
        assert (tmp_path / "once" / file).read_bytes() == (tmp_path / "again" / file).read_bytes(), file


def test_a_scene_that_disagrees_with_the_oracle_is_not_written(renderer, tmp_path, capsys):
    class Wrong:
        def render(self, *arguments):
            frame = renderer.render(*arguments)
            aovs = {name: frame[name].copy() for name in frame}
            aovs["Z"][32, 32] *= 1 + 1e-5
            aovs["count"][30, 30] += 1
            return Frame(aovs, frame.camera, frame.settings, frame.metadata)

    assert not regenerate.regenerate("facing_disc", Wrong(), tmp_path)
    assert not list(tmp_path.iterdir())
    said = capsys.readouterr().out
    assert "count differs at 1 pixels" in said
    assert "depth is off by 1e-05" in said
    assert regenerate.regenerate("facing_disc", renderer, tmp_path)
    assert (tmp_path / "facing_disc.exr").exists()


def test_check_compares_with_the_stored_image(renderer, tmp_path, capsys):
    assert not regenerate.regenerate("facing_disc", renderer, tmp_path, check=True)
    assert "not the bits of facing_disc.exr" in capsys.readouterr().out
    assert not list(tmp_path.iterdir())
    assert regenerate.regenerate("facing_disc", renderer, FOLDER, check=True)


def test_the_page_describes_the_scenes():
    text = (FOLDER / "README.md").read_text(encoding="utf-8")
    assert page.tables(FOLDER, SCENES) in text
    for name in SCENES:
        assert f"**{name}**" in text
    assert scene_names(FOLDER) == sorted(SCENES)


def test_the_facing_disc_covers_the_lattice_points_of_its_circle():
    aovs, _, _ = read_exr(FOLDER / "facing_disc.exr")
    x, y = np.meshgrid(np.arange(64) - 32, np.arange(64) - 32)
    np.testing.assert_array_equal(aovs["count"], x**2 + y**2 <= 20**2)


# ---- the comparison


@pytest.fixture
def frame():
    rng = np.random.default_rng(1)
    aovs = {
        "color": rng.uniform(0.1, 1, (16, 20, 4)).astype(np.float32),
        "Z": np.where(rng.uniform(size=(16, 20)) < 0.5, np.inf, 2.0).astype(np.float32),
        "particleid": rng.integers(0, 9, (16, 20), np.uint32),
    }
    return Frame(aovs, Camera.look_at((0, 0, 1), (0, 0, 0), width=20, height=16), RenderSettings())


def copies(frame):
    return {name: frame[name].copy() for name in frame}


def test_equal_images_have_no_difference(frame):
    assert differences(frame, copies(frame)) == {}
    assert similarity(frame.color, frame.color) == (np.inf, 1.0)


def test_one_ulp_in_one_pixel_is_a_difference(frame):
    other = copies(frame)
    other["color"][3, 4, 1] = np.nextafter(other["color"][3, 4, 1], np.float32(2))
    found = differences(frame, other)
    assert list(found) == ["color"]
    assert found["color"].num_pixels == 1
    assert found["color"].where[3, 4]
    assert 0 < found["color"].largest < 1e-7


def test_an_id_and_the_sign_of_zero_are_differences(frame):
    other = copies(frame)
    other["particleid"][0, 0] ^= 1
    assert differences(frame, other)["particleid"].largest == 1
    zeros = np.zeros((4, 4), np.float32)
    assert difference(-zeros, zeros).num_pixels == 16
    assert difference(-zeros, zeros).largest == 0


def test_infinity_and_nan_hide_nothing(frame):
    infinite = np.argwhere(np.isinf(frame["Z"]))
    other = copies(frame)
    other["Z"][tuple(infinite[0])] = 2
    assert differences(frame, other)["Z"].num_pixels == 1
    assert differences(frame, other)["Z"].largest == np.inf

    with_nan = copies(frame)
    with_nan["color"][0, 0] = np.nan
    assert differences(with_nan, copies(Frame(with_nan, frame.camera, frame.settings))) == {}
    found = differences(frame, with_nan)
    assert (found["color"].num_pixels, found["color"].largest) == (1, np.inf)
    off = {name: aov.copy() for name, aov in with_nan.items()}
    off["color"][5, 5, 0] += np.float32(0.25)
    found = differences(off, with_nan)
    assert found["color"].num_pixels == 1
    assert found["color"].largest == pytest.approx(0.25)
    assert all(np.isfinite(similarity(off["color"], with_nan["color"])))


def test_other_aovs_and_shapes_are_differences(frame):
    with pytest.raises(AssertionError, match="AOVs"):
        differences(frame, {"color": frame.color})
    with pytest.raises(AssertionError, match="shape"):
        difference(frame["Z"], frame["Z"][:4])
    with pytest.raises(AssertionError, match="uint32"):
        difference(frame["particleid"], frame["Z"])


def test_the_report_says_how_much_and_writes_pictures(frame, tmp_path):
    other = copies(frame)
    other["color"][2, 2, :3] = 0
    other["Z"][1, 1:3] = 7
    message = report("scene", frame, other, differences(frame, other), tmp_path / "scene")
    assert "scene is not its reference image" in message
    assert "color: 1 of 320 pixels" in message
    assert "Z: 2 of 320 pixels" in message
    assert "particleid" not in message
    assert "PSNR" in message and "SSIM 0.9" in message
    written = sorted(path.name for path in (tmp_path / "scene").iterdir())
    assert written == ["difference_Z.png", "difference_color.png", "got.exr", "got.png", "reference.png"]
    stored, _, _ = read_exr(tmp_path / "scene" / "got.exr")
    assert differences(frame, stored) == {}
