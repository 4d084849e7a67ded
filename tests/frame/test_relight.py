"""Frame.shade: new light for the AOVs of a render, a file or another renderer."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest
from helpers.cli_stub import run
from helpers.scenes import CAMERAS, EPSILON, random_ellipses

import splatcl
from splatcl import Frame, Light, Material, Npr, RenderSettings, SplatclError, read_frame
from splatcl.cli import MISTAKE
from splatcl.errors import FileError, SettingsError

LIGHTS = (Light("point", (0.5, 1.0, 2.5), (0.9, 0.5, 0.2)), Light(color=(0.25, 0.25, 0.25)))
FIRST = RenderSettings(EPSILON, cutoff=1.5, lights=LIGHTS)
OTHERS = (
    {"lights": LIGHTS[:1], "material": Material(0.2, 0.5, 0.5, 8.0)},
    {"shader": "npr", "npr": Npr(silhouette=0.4)},
)


@pytest.fixture(scope="module")
def frame(renderer):
    return renderer.render(random_ellipses(), CAMERAS["off_center"], FIRST)


@pytest.fixture(scope="module")
def path(frame, tmp_path_factory):
    path = tmp_path_factory.mktemp("relight") / "frame.exr"
    frame.save(path)
    return path


@pytest.mark.parametrize("changes", OTHERS)
def test_bits_are_those_of_a_fresh_render(renderer, frame, path, changes):
    fresh = renderer.render(random_ellipses(), CAMERAS["off_center"], replace(FIRST, **changes))
    for before in (frame, Frame.load(path), pickle.loads(pickle.dumps(frame))):
        after = before.shade(**changes)
        assert after.color.tobytes() == fresh.color.tobytes() != before.color.tobytes()
        assert after.settings == fresh.settings and sorted(after) == sorted(fresh)
        assert after["Z"] is before["Z"] and before.settings == FIRST
    again = frame.shade(**changes).shade(FIRST)
    assert again.color.tobytes() == frame.color.tobytes() and len(set(again.keys())) == len(again)


def test_a_shaded_file_has_the_bytes_of_a_fresh_one(renderer, path, tmp_path):
    renderer.render(random_ellipses(), CAMERAS["off_center"], replace(FIRST, **OTHERS[1])).save(tmp_path / "fresh.exr")
    read_frame(path).shade(**OTHERS[1]).save(tmp_path / "again.exr")
    assert (tmp_path / "again.exr").read_bytes() == (tmp_path / "fresh.exr").read_bytes()


def test_a_loaded_frame_is_as_it_was(frame, path):
    loaded = Frame.load(path)
    assert loaded.settings == frame.settings and loaded.metadata["epsilon"] == EPSILON
    np.testing.assert_array_equal(loaded.camera.eye_from_world, frame.camera.eye_from_world)
    assert sorted(loaded) == sorted(frame) and all(loaded[name].tobytes() == frame[name].tobytes() for name in frame)
    with pytest.raises(SplatclError, match="without its splats"):
        loaded.shade(shader="normal").probe(3, 3)


def test_a_shaded_frame_keeps_its_splats(frame):
    assert frame.shade(shader="normal").probe(24, 18).rows == frame.probe(24, 18).rows


def test_attributes_of_splats_are_shaded_again(renderer, tmp_path):
    """Phong reads the splats' own gloss and a user's shader any attribute, from a render and from a file."""
    rng, splats = np.random.default_rng(0), random_ellipses()
    own = {"heat": rng.random(len(splats)), "shininess": rng.uniform(1, 9, len(splats)), "b": rng.random(len(splats))}
    head = "float4 shade(const Surface s, const Scene scene)"
    user = {"shader": "user", "user_shader": f"{head} {{ return (float4)(s.attribute.heat, s.attribute.b, 0, 1); }}"}
    frame = renderer.render(replace(splats, attributes=own), CAMERAS["off_center"], FIRST)
    frame.save(tmp_path / "frame.exr")
    relit = Frame.load(tmp_path / "frame.exr").shade(**user)
    fresh = renderer.render(replace(splats, attributes=own), CAMERAS["off_center"], relit.settings)
    assert relit.color.tobytes() == fresh.color.tobytes()
    np.testing.assert_array_equal(relit.color[..., 0], frame["attribute.heat"])
    np.testing.assert_array_equal(relit.color[..., 1], frame["attribute.b"])
    assert relit.shade(shader="phong").color.tobytes() == frame.color.tobytes()
    plain = Frame({name: frame[name] for name in ("P", "N", "albedo", "weight")}, frame.camera, FIRST).shade()
    assert plain.color.tobytes() != frame.color.tobytes()


def test_only_shading_can_be_changed(frame):
    with pytest.raises(SettingsError, match=r"cutoff=1.0 needs a new render: this frame was made with 1.5"):
        frame.shade(cutoff=1.0)
    with pytest.raises(SettingsError, match=r"epsilon=0.5 needs a new render"):
        frame.shade(RenderSettings(0.5))
    with pytest.raises(SettingsError, match="no setting colour; shading takes shader, user_shader"):
        frame.shade(colour=1)
    # Fields at their defaults count as not given, so they need no new render.
    assert frame.shade(RenderSettings(shader="albedo")).settings == replace(FIRST, shader="albedo", lights=(Light(),))


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        (RenderSettings(method="botsch04"), "shading='fragment' lit each fragment before blending; render it again"),
        (RenderSettings(method="botsch03"), "shading='splat' lit each splat before blending; render it again"),
        (RenderSettings(supersampling=2), "supersampling=2 averaged its surface; render it again"),
    ],
)
def test_blended_light_cannot_be_undone(frame, settings, says):
    with pytest.raises(SplatclError, match=f"cannot shade this frame again: {says}"):
        Frame({name: frame[name] for name in frame}, frame.camera, settings).shade(shader="normal")


def test_aovs_of_another_renderer(frame):
    """P, N and albedo suffice; weight tells the coverage, else alpha, else the normals."""
    own = {name: frame[name].astype(np.float64) for name in ("P", "N", "albedo")}
    alpha = frame.color * (0, 0, 0, 0.5)
    for more in ({}, {"color": alpha}, {"weight": frame["weight"]}):
        shaded = Frame(own | more, frame.camera).shade(lights=LIGHTS)
        np.testing.assert_array_equal(shaded.color, frame.color)
    empty = Frame(own | {"weight": np.zeros_like(frame["weight"])}, frame.camera).shade()
    assert not empty.color.any()
    with pytest.raises(SettingsError, match=r"npr.contour='auto' needs the render's epsilon, which this frame lacks"):
        Frame(own, frame.camera).shade(shader="npr")
    assert Frame(own, frame.camera).shade(shader="npr", npr=Npr(contour=0.1)).color.any()


def test_missing_or_misshapen_aovs_are_named(frame):
    own = {name: frame[name] for name in ("P", "N", "albedo")}
    for name in own:
        rest = {other: aov for other, aov in own.items() if other != name}
        with pytest.raises(SplatclError, match=f"needs the AOVs P, N and albedo; this frame has no {name}$"):
            Frame(rest, frame.camera).shade()
        with pytest.raises(SplatclError, match=rf"AOV {name} is float32 of shape \(37, 49\); shading needs numbers of"):
            Frame(own | {name: own[name][..., 0]}, frame.camera).shade()


def test_a_file_of_someone_else_is_refused(tmp_path):
    import OpenEXR

    other = tmp_path / "other.exr"
    OpenEXR.File({}, {"Z": np.zeros((2, 2), np.float32)}).write(str(other))
    with pytest.raises(FileError, match=r"other\.exr: has no camera and settings of splatcl"):
        read_frame(other)
    with pytest.raises(FileError, match=r"none\.exr: cannot read"):
        read_frame(tmp_path / "none.exr")


def test_settings_of_another_version_are_refused(frame, tmp_path, monkeypatch):
    import splatcl.io.exr as exr

    describe = exr._describe
    monkeypatch.setattr(exr, "_describe", lambda *a: describe(*a).replace('"cutoff"', '"warp"'))
    frame.save(tmp_path / "new.exr")
    with pytest.raises(
        SettingsError, match=r"new\.exr: has settings of another version of splatcl \(unknown field warp"
    ):
        read_frame(tmp_path / "new.exr")


def test_on_the_command_line(frame, path, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    options = "--shader npr --npr.silhouette 0.4 --npr.tones 0.2 0.8 --npr.line 0 0 1 -o out.exr --png out.png"
    status, out, err = run(capsys, f"shade {path} {options}")
    assert (status, err) == (0, [])
    assert out[0].startswith("shaded 49x37 with npr in ") and out[1].startswith("wrote out.exr") and len(out) == 3
    npr = Npr((0.2, 0.8), silhouette=0.4, line=(0, 0, 1))
    after = read_frame("out.exr")
    assert after.settings == replace(FIRST, shader="npr", npr=npr)
    assert after.color.tobytes() == frame.shade(shader="npr", npr=npr).color.tobytes()
    assert run(capsys, f"shade {path} -o lit.exr --material.ambient 0.5")[0] == 0
    assert read_frame("lit.exr").settings == replace(FIRST, material=Material(ambient=0.5))
    for wrong, says in (
        ("--shader user", "--user-shader"),
        ("--cutoff 1", "--cutoff"),
        ("--npr.contour -1", "--npr.contour -1.0 must be between"),
        ("--shader normal --user-shader s.cl", "--user-shader and --shader normal cannot be combined"),
    ):
        status, _, err = run(capsys, f"shade {path} -o no.exr {wrong}")
        assert status == MISTAKE and len(err) == 1 and says in err[0]
    assert run(capsys, "shade none.exr -o no.exr")[::2] == (
        MISTAKE,
        ["splatcl: error: none.exr: cannot read: No such file or directory"],
    )
    assert splatcl.read_frame is read_frame and not (tmp_path / "no.exr").exists()
