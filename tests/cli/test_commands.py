"""The command line: options, output, exit statuses, one-line errors."""

from __future__ import annotations

from typing import get_args, get_origin, get_type_hints

import imageio.v3 as iio
import numpy as np
import pytest
from helpers.cli_stub import SPLATS, run, stub

import splatcl
from splatcl import Camera, RenderSettings
from splatcl.cli import FAILED, INTERRUPTED, MISTAKE, main
from splatcl.cli.options.view import axis_vector
from splatcl.errors import DeviceError, FileError
from splatcl.io.cameras import write_camera
from splatcl.io.exr import read_exr
from splatcl.io.inspect import Summary

__all__ = ["stub"]  # a fixture


def test_render_writes_both_outputs_and_says_what_it_did(stub, capsys, tmp_path):
    status, out, err = run(capsys, "render scan.ply -o out.exr --png out.png --size 80x60 --azimuth 30 --elevation -20")
    assert (status, err) == (0, [])
    assert out[0].startswith("read scan.ply: 1 splats in ")
    assert out[1] == "note: estimated 1 normal from 8 neighbors"
    assert out[2].startswith("rendered 80x60 in ") and "cover 50.0% of the image" in out[2]
    assert out[3:5] == ["device stub", "epsilon 0.5 (auto)"]
    assert out[5].startswith("wrote out.exr (") and out[6].startswith("wrote out.png (") and len(out) == 7
    assert sorted(p.name for p in tmp_path.iterdir()) == ["out.exr", "out.png"]
    assert read_exr("out.exr")[0]["color"].shape == (60, 80, 4)
    assert iio.imread("out.png").shape == (60, 80, 4)
    camera = stub.calls[0][1]
    expected = Camera.framing(SPLATS.bounding_sphere, 30, -20, up=(0, 0, 1), width=80, height=60)
    np.testing.assert_array_equal(camera.eye_from_world, expected.eye_from_world)
    assert (camera.width, camera.height, camera.fx) == (80, 60, expected.fx)


def test_view_options_reach_the_camera(stub, capsys):
    run(capsys, "render s.ply --png o.png --up -x --fov 20 --projection orthographic")
    expected = Camera.framing(SPLATS.bounding_sphere, up=(-1, 0, 0), fov_y=20, projection="orthographic")
    camera = stub.calls[0][1]
    np.testing.assert_array_equal(camera.eye_from_world, expected.eye_from_world)
    assert (camera.fx, camera.projection, camera.width) == (expected.fx, "orthographic", 512)


def test_axis_vectors():
    assert axis_vector("x") == (1, 0, 0) and axis_vector("-y") == (0, -1, 0) and axis_vector("-z") == (0, 0, -1)


def test_a_camera_file_replaces_the_framing(stub, capsys, tmp_path):
    write_camera(Camera.look_at((1, 2, 3), (0, 0, 0), width=33, height=44), tmp_path / "c.json")
    status, out, _ = run(capsys, "render s.ply --png o.png --camera c.json")
    assert status == 0 and any(line.startswith("rendered 33x44") for line in out)
    np.testing.assert_allclose(stub.calls[0][1].position, (1, 2, 3))
    for option in ("--azimuth 3", "--size 4x4", "--fov 0", "--up y", "--projection perspective"):
        name = option.split()[0]
        status, _, err = run(capsys, f"render s.ply --png o.png --camera c.json {option}")
        assert status == MISTAKE and err == [
            f"splatcl: error: --camera and {name} cannot be combined: the camera file sets the view; remove {name}"
        ]


def test_settings_reach_the_renderer(stub, capsys):
    options = "--epsilon 0.01 --along ray --prefilter none --prefilter-radius 2 --prefilter-center bounds"
    options += " --cutoff 1.5 --kernel table --kernel-table 1 0.5 0 --kernel-lookup linear --facing cull"
    options += " --shader normal --material.ambient 0.25"
    status, out, err = run(capsys, f"render s.ply --png o.png {options}")
    assert (status, err) == (0, [])
    settings = stub.calls[0][2]
    assert settings == RenderSettings(
        epsilon=0.01,
        along="ray",
        prefilter="none",
        prefilter_radius=2,
        prefilter_center="bounds",
        cutoff=1.5,
        kernel="table",
        kernel_table=(1, 0.5, 0),
        kernel_lookup="linear",
        facing="cull",
        shader="normal",
        material=splatcl.Material(ambient=0.25),
    )
    assert "epsilon 0.01" in out


def test_without_options_the_settings_are_the_defaults(stub, capsys):
    run(capsys, "render s.ply --png o.png")
    run(capsys, "render s.ply --png o.png --epsilon auto")
    assert stub.calls[0][2] == stub.calls[1][2] == RenderSettings()
    assert stub.made == {"device": None, "tile_size": 16, "allow_inexact": False}


def test_every_setting_with_choices_is_an_option_with_those_choices(capsys):
    """A new choice in RenderSettings needs no change of the command line."""
    hints = get_type_hints(RenderSettings)
    choices = {name: get_args(hint) for name, hint in hints.items() if get_origin(hint) is not None}
    literal = {name: args for name, args in choices.items() if all(isinstance(a, str) for a in args)}
    assert {"along", "prefilter", "kernel", "facing", "shader"} <= set(literal)
    for name, values in literal.items():
        status, _, err = run(capsys, f"render s.ply --{name.replace('_', '-')} nonsense")
        assert status == MISTAKE and all(f'"{value}"' in err[0] for value in values), name


def test_device_tile_size_and_on_invalid_are_passed_on(stub, capsys, monkeypatch):
    asked = []
    monkeypatch.setattr("splatcl.io.read.read", lambda *args: asked.append(args) or SPLATS)
    options = "--device intel --tile-size 32 --on-invalid drop"
    assert run(capsys, f"render s.ply --png o.png {options}")[0] == 0
    assert stub.made == {"device": "intel", "tile_size": 32, "allow_inexact": False}
    assert str(asked[0][0]) == "s.ply" and asked[0][1] == "drop"


def test_exposure_is_for_the_png_only(stub, capsys):
    assert run(capsys, "render s.ply -o o.exr --png o.png --exposure -1")[0] == 0
    assert iio.imread("o.png")[0, 0, 0] == 99  # 255 * (1.055 * 0.125^(1/2.4) - 0.055)
    assert read_exr("o.exr")[0]["color"][0, 0, 0] == 0.25
    status, _, err = run(capsys, "render s.ply -o o.exr --exposure 1")
    assert (
        status == MISTAKE and "--exposure needs a PNG, since an .exr holds linear values; give --png FILE.png" in err[0]
    )


def test_output_may_be_a_png(stub, capsys):
    assert run(capsys, "render s.ply -o o.png --exposure 1")[0] == 0
    assert iio.imread("o.png")[0, 0, 0] == 188  # linear 0.5


MISTAKES = [
    ("render", "SCAN requires an argument"),
    ("render s.ply", "no output is named; give -o FILE.exr"),
    ("render s.ply -o o.jpg", "o.jpg: cannot write .jpg; use .exr or .png"),
    ("render s.ply --png o.exr", "--png o.exr: the name must end in .png; write .exr with -o"),
    ("render s.ply -o o.png --png ./o.png", "-o and --png both name o.png; give two names"),
    ("render s.ply -o missing/o.exr", "does not exist"),
    ("render s.ply -o folder.exr", "it is a folder"),
    ("render s.ply -o o.exr --png missing/o.png", "does not exist"),
    ("render s.ply -o o.exr --size 800", "--size '800' must be WIDTHxHEIGHT"),
    ("render s.ply -o o.exr --size 0x5", "0x5' must be WIDTHxHEIGHT"),
    ("render s.ply -o o.exr --size 99999x5", "--size 99999x5"),
    ("render s.ply -o o.exr --fov 180", "--fov 180.0 must"),
    ("render s.ply -o o.exr --fov 0", "--fov 0.0 must"),
    ("render s.ply -o o.exr --azimuth inf", "--azimuth inf must be finite"),
    ("render s.ply -o o.exr --size -3x5", "--size"),
    ("render s.ply -o o.exr --epsilon -1", "--epsilon -1.0"),
    ("render s.ply -o o.exr --epsilon abc", "abc"),
    ("render s.ply -o o.exr --facing sideways", '"keep", "flip", "cull"'),
    (
        "render s.ply -o o.exr --kernel table",
        "error: --kernel table and --kernel-table need each other; give both or neither",
    ),
    ("render s.ply -o o.exr --up w", "--up"),
    ("render s.ply -o o.exr --elevation 91", "--elevation 91.0 must be between -90 and 90"),
    ("render s.ply -o o.exr --camera missing.json", "missing.json: cannot read"),
    ("render s.ply -o o.png --exposure nan", "--exposure nan"),
    ("render s.ply -o o.exr --lights.0.kind point", "Unknown option"),
    ("render s.ply -o o.exr --nonsense", "Unknown option"),
    ("render s.ply t.ply -o o.exr", "t.ply"),
    ("nonsense", "Unknown command"),
    ("--nonsense", "--nonsense"),
    ("info", "FILE requires an argument"),
]


@pytest.mark.parametrize(("command", "message"), MISTAKES)
def test_mistakes_are_one_line_and_status_2_before_anything_is_rendered(stub, capsys, tmp_path, command, message):
    (tmp_path / "folder.exr").mkdir()
    status, out, err = run(capsys, command)
    assert status == MISTAKE and len(err) == 1 and err[0].startswith("splatcl: error: ")
    assert message in err[0]
    assert stub.calls == [] and out == []
    assert [p.name for p in tmp_path.iterdir()] == ["folder.exr"]


def test_outputs_are_checked_before_the_scan_is_read(stub, capsys, monkeypatch):
    monkeypatch.setattr("splatcl.io.read.read", lambda *a: pytest.fail("it was read"))
    assert run(capsys, "render s.ply -o missing/o.exr")[0] == MISTAKE
    assert run(capsys, "render s.ply -o o.exr --size 1")[0] == MISTAKE


@pytest.mark.parametrize(
    ("error", "status", "message"),
    [
        (FileError("s.ply: not a PLY file"), MISTAKE, "splatcl: error: s.ply: not a PLY file"),
        (DeviceError("no device"), MISTAKE, "splatcl: error: no device"),
        (MemoryError(), FAILED, "splatcl: error: out of memory"),
        (OSError(5, "Input/output error"), FAILED, "splatcl: error: [Errno 5] Input/output error"),
        (KeyboardInterrupt(), INTERRUPTED, None),
    ],
)
def test_statuses(stub, capsys, monkeypatch, error, status, message):
    def fail(*args):
        raise error

    monkeypatch.setattr("splatcl.io.read.read", fail)
    assert run(capsys, "render s.ply -o o.exr") == (status, [], [message] if message else [])


def test_an_unforeseen_error_keeps_its_traceback(stub, monkeypatch):
    def fail(*args):
        raise ZeroDivisionError("a bug")

    monkeypatch.setattr("splatcl.io.read.read", fail)
    with pytest.raises(ZeroDivisionError):
        main(["render", "s.ply", "-o", "o.exr"])


def test_info_prints_the_summary(capsys, tmp_path):
    (tmp_path / "s.xyz").write_text("0 0 0\n1000000.5 0 0\n1000000.5 2 0\nnan 0 0\n")
    status, out, err = run(capsys, f"info {tmp_path}/s.xyz")
    assert (status, err) == (0, [])
    assert out[0].startswith(f"{tmp_path}/s.xyz: ")
    assert out[1:7] == [
        "points      4",
        "attributes  none but positions",
        "minimum     0 0 0",
        "maximum     1000000.5 2 0",
        "size        1e+06 2 0",
        "spacing     2 (median distance to the nearest neighbor)",
    ]
    assert out[7].startswith("skipped     1 points with a non-finite ")


def test_info_prints_triangles_and_notes(capsys, monkeypatch, tmp_path):
    summary = Summary(
        path=tmp_path,
        format="OBJ (text)",
        num_points=3,
        num_faces=1,
        bounds=np.zeros((2, 3)),
        attributes=("normals", "color"),
        spacing=0.5,
        skipped=(),
        notes=("ignored lines of vt",),
    )
    monkeypatch.setattr("splatcl.io.inspect.inspect", lambda path: summary)
    _, out, _ = run(capsys, "info s.obj")
    assert out[2:4] == ["triangles   1", "attributes  normals, color"]
    assert out[-2:] == ["skipped     nothing", "note: ignored lines of vt"]
