"""A user's shader: its inputs, the examples, and the messages for its mistakes."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.cli_stub import run
from helpers.paths import ROOT
from helpers.scenes import CAMERAS, EPSILON, random_ellipses
from tolerances import USER_SHADED

from splatcl import Frame, Light, RenderSettings, SplatclError, write
from splatcl.cli import MISTAKE
from splatcl.errors import SettingsError
from splatcl.opencl.passes.user_shader import build_error

EXAMPLES = sorted((ROOT / "examples" / "shaders").glob("*.cl"))
LIGHTS = (
    Light("point", (0.5, 1.0, 2.5), (0.9, 0.5, 0.2)),
    Light("directional", (1, 2, 3)),
    Light(color=(0.2, 0.3, 0.4)),
)
PHONG = """
float4 shade(const Surface s, const Scene scene)
{
  float3 rgb = scene.ambient * s.albedo;
  for (int i = 0; i < scene.num_lights; ++i) {
    const Light l = light_at(s, scene, i);
    const float n_l = dot(s.normal, l.toward);
    const float r_v = dot(2.0f * n_l * s.normal - l.toward, s.to_eye);
    if (n_l > 0.0f)
      rgb += l.color * (scene.diffuse * n_l * s.albedo + scene.specular * pow(fmax(r_v, 0.0f), scene.shininess));
  }
  return (float4)(rgb, 1.0f);
}
"""
SEEN = """
float4 shade(const Surface s, const Scene scene)
{
  if (s.x % 2) return (float4)(depth_at(s, 1, -2), normal_at(s, -1, 3));
  return (float4)(s.depth, s.position.x, s.attribute.heat, scene.time + s.attribute.b2 + 100 * s.y);
}
"""


def user(text, **more):
    return {"shader": "user", "user_shader": text, "user_shader_name": "mine.cl", **more}


@pytest.fixture(scope="module")
def frame(renderer):
    return renderer.render(random_ellipses(), CAMERAS["off_center"], RenderSettings(EPSILON, lights=LIGHTS))


def test_a_frame_of_a_user_s_shader_is_accounted_for(renderer):
    settings = RenderSettings(EPSILON, **user(PHONG))
    assert all(one.passed for one in renderer.render(random_ellipses(), CAMERAS["off_center"], settings).check())


def test_a_user_can_write_phong(renderer, frame):
    shaded = frame.shade(**user(PHONG))
    n_v = np.abs((frame["N"] * frame["P"]).sum(axis=-1))
    np.testing.assert_allclose(shaded.color[n_v > 0], frame.color[n_v > 0], rtol=0, atol=USER_SHADED)
    fresh = renderer.render(random_ellipses(), CAMERAS["off_center"], shaded.settings)
    assert fresh.color.tobytes() == shaded.color.tobytes()


@pytest.mark.parametrize("precision", ["single", "double"])
def test_the_inputs_of_a_shader(frame, precision):
    rng = np.random.default_rng(0)
    heat, b2 = rng.random((2, frame.height, frame.width)).astype(np.float32)
    own = {name: frame[name] for name in ("P", "N", "albedo", "weight")}
    aovs = own | {"attribute.heat": heat, "attribute.b2": b2}
    got = Frame(aovs, frame.camera, RenderSettings(precision=precision)).shade(**user(SEEN, time=0.5)).color
    covered = frame["weight"] > 0
    z = np.where(covered, frame["P"][..., 2], np.inf)
    y, x = np.mgrid[: frame.height, : frame.width]

    def around(values, dx, dy):
        inside = (x + dx >= 0) & (x + dx < frame.width) & (y + dy >= 0) & (y + dy < frame.height)
        return values[np.where(inside, y + dy, y), np.where(inside, x + dx, x)]

    neighbors = np.concatenate([around(z, 1, -2)[..., None], around(frame["N"], -1, 3)], axis=-1)
    time = np.float32(0.5) + b2 + 100 * y
    place = np.stack([z, frame["P"][..., 0], heat, time], axis=-1)
    want = np.where(covered[..., None], np.where((x % 2 > 0)[..., None], neighbors, place), 0)
    np.testing.assert_allclose(got, want, rtol=1e-6)


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_examples(frame, path):
    assert len(EXAMPLES) == 3
    text = path.read_text()
    colors = [frame.shade(**user(text, time=time)).color for time in (0.0, 0.3)]
    covered = frame["weight"] > 0
    assert np.isfinite(colors[0]).all() and (colors[0][..., 3] == covered).all()
    assert len(np.unique(colors[0][covered], axis=0)) > 3
    assert ("time" in text) == (colors[0] != colors[1]).any()


HEAD = "float4 shade(const Surface s, const Scene scene)"
WRONG = {
    f"\n\n{HEAD}\n{{\n  return heat;\n}}": "mine.cl:5: use of undeclared identifier 'heat'",
    f"{HEAD}\n{{ return s.attribute.heat; }}": "mine.cl:2: no member named 'heat'",
    f"#error too dark\n{HEAD}": "mine.cl:1: too dark",
    "float4 shade(float x) { return x; }": rf"mine.cl: must define {re.escape(HEAD)}",
    "float4 color(const Surface s) { return 1.0f; }": f"mine.cl: has no function {re.escape(HEAD)}",
    "": f"shader='user' needs user_shader; set it to OpenCL C with a function {re.escape(HEAD)}",
}


@pytest.mark.parametrize("text", WRONG)
def test_mistakes_name_the_users_file_and_line(frame, text):
    with pytest.raises(SettingsError, match=f"^{WRONG[text]}") as caught:
        frame.shade(**user(text))
    assert "\n" not in str(caught.value)


def test_logs_of_other_compilers():
    settings = RenderSettings(user_shader="x", shader="user", user_shader_name="mine.cl")
    log = "warning: mine.cl:1:1: odd\nmine.cl:7:3: error: a\nmine.cl:8:3: fatal error: b\nmine.cl:9:1: error: c\n"
    log += "q.h:1:1: error: d"
    assert str(build_error(log, settings)) == "mine.cl:7: a; mine.cl:8: b; mine.cl:9: c (and 1 more)"
    assert str(build_error("no\nidea", settings)) == "mine.cl: does not compile: no idea"


def test_names_of_any_kind(frame):
    """File names may hold characters that C strings cannot, and AOV names characters that C fields cannot."""
    wrong = replace(
        RenderSettings(**user(f"{HEAD} {{ x; }}")),
        user_shader_name='a "b"\\c.cl',
    )
    with pytest.raises(SettingsError, match=r'^a "b"\\c.cl:1: '):
        frame.shade(wrong)
    aovs = {name: frame[name] for name in ("P", "N", "albedo")} | {"attribute.two words": frame["Z"]}
    with pytest.raises(SplatclError, match=r"AOV attribute.two words cannot be a field of s.attribute"):
        Frame(aovs, frame.camera).shade(**user(PHONG))
    assert frame.shade(**user(PHONG)).shade(shader="albedo").settings.user_shader == ""


def test_on_the_command_line(frame, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    frame.save("out.exr")
    write(random_ellipses(num=20), "s.ply")
    Path("mine.cl").write_text(PHONG)
    Path("bad.cl").write_text("float4 shade(const Surface s, const Scene scene)\n{\n  return foo;\n}\n")
    assert run(capsys, "shade out.exr -o again.exr --shader user --user-shader mine.cl --time 2")[::2] == (0, [])
    again = Frame.load("again.exr")
    assert again.settings == replace(frame.settings, **user(PHONG, time=2.0))
    assert again.color.tobytes() == frame.shade(**user(PHONG)).color.tobytes()
    options = "render s.ply -o no.exr --size 16x16"
    status, _, err = run(capsys, f"{options} --user-shader bad.cl")
    assert status == MISTAKE and len(err) == 1 and not Path("no.exr").exists()
    assert err[0].startswith("splatcl: error: bad.cl:3: use of undeclared identifier 'foo'")
    for wrong, says in (
        ("--shader user", "--shader user needs --user-shader FILE.cl"),
        ("--shader npr --user-shader mine.cl", "--user-shader and --shader npr cannot be combined; remove one"),
        ("--user-shader none.cl", "none.cl: cannot read: No such file or directory"),
    ):
        assert run(capsys, f"{options} {wrong}") == (MISTAKE, [], [f"splatcl: error: {says}"])
