"""The view that the command line chooses: the up axis, the side, and the notes on the picture."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.cli_stub import run, stub

from splatcl import Camera, Splats

__all__ = ["stub"]  # a fixture
SQUARE = [[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]
TURNED = "note: the camera is at azimuth 180, where the normals point; --azimuth 0 shows the other side"
AWAY = "note: most normals face away from the camera; try --facing flip"


def sheet(normal_z, oriented=True):
    """Return four splats in a plane, with all normals along +z or all along -z."""
    return Splats(SQUARE, [[1.0, 0, 0]] * 4, [[0, float(normal_z), 0]] * 4, oriented=oriented)


def render(stub, capsys, monkeypatch, splats, options=""):
    """Return the camera of the render and the printed notes."""
    monkeypatch.setattr("splatcl.io.read.read", lambda path, on_invalid="error": splats)
    monkeypatch.setattr("splatcl.io.read.up_axis", lambda path: "y")
    status, out, err = run(capsys, f"render s.ply --png o.png {options}")
    assert (status, err) == (0, [])
    return stub.calls[-1][1], [line for line in out if line.startswith("note: ")]


def test_a_scan_of_one_side_is_seen_from_that_side(stub, capsys, monkeypatch):
    camera, notes = render(stub, capsys, monkeypatch, sheet(-1), "--elevation 20")
    expected = Camera.framing(sheet(1).bounding_sphere, 180, 20)
    np.testing.assert_array_equal(camera.eye_from_world, expected.eye_from_world)
    assert notes == [TURNED]


@pytest.mark.parametrize(
    ("splats", "options", "side"),
    [
        (sheet(1), "", 1),
        (sheet(-1), "--azimuth 0", 1),
        (sheet(-1), "--azimuth 180", -1),
        (sheet(-1, oriented=False), "", 1),
        (Splats(SQUARE, [[1.0, 0, 0]] * 4, [[0, s, 0] for s in (1.0, -1, 1, -1)]), "", 1),  # no side is the front
        (sheet(1).take([]), "", 1),
    ],
)
def test_otherwise_the_side_stays(stub, capsys, monkeypatch, splats, options, side):
    camera, notes = render(stub, capsys, monkeypatch, splats, options)
    assert np.sign(camera.position[2]) == side
    assert TURNED not in notes


def test_no_side_is_better_from_above(stub, capsys, monkeypatch):
    down = Splats([[0.0, 0, 0]], [[1.0, 0, 0]], [[0.0, 0, 1]])  # its normal is -y
    camera, notes = render(stub, capsys, monkeypatch, down, "--elevation 60")
    assert camera.position[2] > 0 and TURNED not in notes


@pytest.mark.parametrize(
    ("normal", "options", "told"),
    [
        ((0, 0, 1), "", True),
        ((0, 0, 0.01), "--projection orthographic", True),
        ((0, 0, -1), "", False),
        ((0, 0, 1), "--facing flip", False),
        ((0, 0, 1), "--facing cull", False),
        ((-1, 0, 0.1), "", True),  # the eye sees the covered left half of the image from behind
        ((-1, 0, 0.1), "--projection orthographic", True),
        ((1, 0, 0.1), "--fov 90", False),
    ],
)
def test_normals_that_face_away_are_told(stub, capsys, monkeypatch, normal, options, told):
    monkeypatch.setattr(stub, "normal", normal)
    assert (AWAY in render(stub, capsys, monkeypatch, sheet(1), options)[1]) == told


def test_only_covered_pixels_count_and_a_sample_of_them_does(stub, capsys, monkeypatch):
    monkeypatch.setattr(stub, "normal", (0, 0, 1))
    monkeypatch.setattr("splatcl.cli.commands.render.MAX_SAMPLES", 100)
    assert AWAY in render(stub, capsys, monkeypatch, sheet(1), "--size 90x70")[1]


def test_an_empty_picture_is_told(stub, capsys, monkeypatch):
    monkeypatch.setattr(stub, "share", 0.0)
    notes = render(stub, capsys, monkeypatch, sheet(1))[1]
    assert notes == ["note: no splat is visible; check the camera's position, axes, near and far"]


@pytest.mark.parametrize("elevation", [90, -90])
def test_straight_from_above_and_below(stub, capsys, monkeypatch, elevation):
    camera, _ = render(stub, capsys, monkeypatch, sheet(1), f"--elevation {elevation}")
    assert np.sign(camera.position[1]) == np.sign(elevation)
