"""Camera files: axes, both matrices, exact round trips, errors that name file and key."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
from helpers.paths import ROOT

from splatcl import Camera
from splatcl.errors import CameraError, FileError
from splatcl.io.cameras import KEYS, read_camera, write_camera

# The eye is at (0, 0, 3) and looks along -z of the world with y up: right is +x, down is -y, forward is -z.
OPENCV = [[1, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 3], [0, 0, 0, 1]]
OPENGL = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, -3], [0, 0, 0, 1]]
OPENCV_POSE = [[1, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 3], [0, 0, 0, 1]]
OPENGL_POSE = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 3], [0, 0, 0, 1]]
INTRINSICS = {"width": 80, "height": 60, "fx": 50.0, "fy": 40.0, "cx": 41.0, "cy": 28.5}


def write_json(path, **changes):
    values = {**INTRINSICS, "axes": "opencv", "eye_from_world": OPENCV, **changes}
    path.write_text(json.dumps({key: value for key, value in values.items() if value is not ...}))
    return path


@pytest.mark.parametrize(
    ("axes", "key", "matrix"),
    [
        ("opencv", "eye_from_world", OPENCV),
        ("opengl", "eye_from_world", OPENGL),
        ("opencv", "world_from_eye", OPENCV_POSE),
        ("opengl", "world_from_eye", OPENGL_POSE),
    ],
)
def test_axes_and_directions_give_the_same_camera(tmp_path, axes, key, matrix):
    changes = {"eye_from_world": ..., key: matrix}
    camera = read_camera(write_json(tmp_path / "c.json", axes=axes, **changes))
    np.testing.assert_array_equal(camera.eye_from_world, OPENCV)
    # (0.3, 0.2, 1) is 2 in front of the eye, 0.3 to the right and 0.2 above. It projects to
    # x = 50 * 0.3/2 + 41 = 48.5 and y = 40 * -0.2/2 + 28.5 = 24.5, the center of pixel (48, 24).
    raster, z = camera.project((0.3, 0.2, 1))
    np.testing.assert_allclose(raster, (48.5, 24.5), rtol=1e-14)
    assert z == 2


def test_a_general_pose_is_inverted(tmp_path):
    camera = Camera.look_at((1, 2, 3), (-1, 0.5, 0), up=(0.1, 1, 0.2), width=80, height=60)
    for axes, flip in [("opencv", np.eye(4)), ("opengl", np.diag([1.0, -1, -1, 1]))]:
        pose = np.linalg.inv(camera.eye_from_world) @ flip
        np.testing.assert_allclose(pose[:3, 3], (1, 2, 3))
        path = write_json(tmp_path / "c.json", axes=axes, eye_from_world=..., world_from_eye=pose.tolist())
        np.testing.assert_allclose(read_camera(path).eye_from_world, camera.eye_from_world, atol=1e-14)


def test_defaults_are_those_of_camera(tmp_path):
    camera = read_camera(write_json(tmp_path / "c.json"))
    assert (camera.near, camera.far, camera.projection) == (1e-3, float("inf"), "perspective")
    assert read_camera(write_json(tmp_path / "c.json", far=None)).far == float("inf")


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"near": 0.1, "far": 1 / 3},
        {"near": -1e-17, "far": 1e30, "projection": "orthographic"},
        {"cx": -np.pi, "cy": 1e-300, "fx": np.nextafter(1, 2), "width": 1, "height": 16384},
    ],
)
def test_round_trip_is_exact(tmp_path, changes):
    matrix = Camera.look_at((1e6 / 3, 2, 3), (-1, 0.7, 0), up=(0.1, 1, 0.2)).eye_from_world
    camera = Camera(matrix, **{**INTRINSICS, **changes})
    write_camera(camera, tmp_path / "c.json")
    back = read_camera(tmp_path / "c.json")
    assert back.eye_from_world.tobytes() == camera.eye_from_world.tobytes()
    for name in ("fx", "fy", "cx", "cy", "width", "height", "near", "far", "projection"):
        assert getattr(back, name) == getattr(camera, name)
        assert type(getattr(back, name)) is type(getattr(camera, name))


def test_written_files_are_strict_json_and_leave_nothing_else(tmp_path):
    write_camera(Camera(np.array(OPENCV), **INTRINSICS), tmp_path / "c.json")
    values = json.loads((tmp_path / "c.json").read_text(), parse_constant=pytest.fail)
    assert values["far"] is None and values["axes"] == "opencv" and set(values) < set(KEYS)
    assert [p.name for p in tmp_path.iterdir()] == ["c.json"]
    with pytest.raises(FileError, match="does not exist"):
        write_camera(Camera(np.array(OPENCV), **INTRINSICS), tmp_path / "no" / "c.json")


SCALED = (2 * np.eye(4)).tolist()
BAD = [
    ({"axes": ...}, "axes is missing"),
    ({"width": ...}, "width is missing"),
    ({"axes": "colmap"}, "axes 'colmap' must be 'opencv' or 'opengl'"),
    ({"axes": ["opencv"]}, "axes"),
    ({"fov": 45}, "unknown key 'fov'; it must be one of width, height, fx"),
    ({"eye_from_world": ...}, "exactly one of eye_from_world and world_from_eye"),
    ({"world_from_eye": OPENCV}, "exactly one of eye_from_world and world_from_eye"),
    ({"fx": "50"}, "fx '50' must be a number"),
    ({"fx": True}, "fx True must be a number"),
    ({"fx": None}, "fx None must be a number"),
    ({"fx": -1}, "fx -1"),
    ({"fx": float("nan")}, "fx must be a finite number"),
    ({"cx": 10**400}, "cx must be a finite number"),
    ({"near": None}, "near None must be a number"),
    ({"near": 0}, "near 0"),
    ({"near": 2, "far": 1}, "far 1"),
    ({"width": 80.5}, "width"),
    ({"width": 0}, "0x60"),
    ({"projection": "fisheye"}, "projection 'fisheye'"),
    ({"projection": 1}, "projection 1 must be a string"),
    ({"eye_from_world": 3}, "eye_from_world must be a list of four rows"),
    ({"eye_from_world": OPENCV[:3]}, "eye_from_world must be a list of four rows"),
    ({"eye_from_world": [[1, 2], [3], [4], [5]]}, "eye_from_world must have rows of four"),
    ({"eye_from_world": [*OPENCV[:3], [0, 0, 0, "1"]]}, "eye_from_world '1' must be a number"),
    ({"eye_from_world": SCALED}, "eye_from_world is not a rotation"),
    ({"eye_from_world": ..., "world_from_eye": SCALED}, "world_from_eye is not a rotation"),
    ({"eye_from_world": np.diag([1.0, 1, -1, 1]).tolist()}, "eye_from_world is not a rotation"),
]


@pytest.mark.parametrize(("changes", "message"), BAD)
def test_bad_values_name_the_file_and_the_key(tmp_path, changes, message):
    path = write_json(tmp_path / "c.json", **changes)
    with pytest.raises(CameraError, match=f"^{re.escape(str(path))}: .*{re.escape(message)}") as caught:
        read_camera(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "not a JSON camera file"),
        (b"{", "not a JSON camera file"),
        (b"\xff\xfe\x00ply", "not a JSON camera file"),
        (b"[" * 100000, "not a JSON camera file"),
        (b'{"width": 1' + b"0" * 5000 + b"}", "not a JSON camera file"),
        (b"[1, 2]", "one JSON object, not a list"),
        (b'{"fx": 1, "fx": 2}', "fx is given twice"),
    ],
)
def test_files_that_are_no_camera(tmp_path, content, message):
    path = tmp_path / "c.json"
    path.write_bytes(content)
    with pytest.raises((FileError, CameraError), match=f"^{re.escape(str(path))}: .*{message}"):
        read_camera(path)


def test_unreadable_paths_are_file_errors(tmp_path):
    for path in (tmp_path, tmp_path / "missing.json"):
        with pytest.raises(FileError, match=re.escape(f"{path}: cannot read")):
            read_camera(path)


def test_the_example_of_the_documentation_is_what_its_text_says(tmp_path):
    page = ROOT / "docs" / "guide" / "cameras.md"
    example = re.search(r"```json\n(.*?)```", page.read_text(), re.DOTALL)
    assert example
    (tmp_path / "c.json").write_text(example[1])
    camera = read_camera(tmp_path / "c.json")
    np.testing.assert_array_equal(camera.position, (0, 0, 3))
    np.testing.assert_array_equal(camera.project((0, 0, 0))[0], (400, 300))
    assert camera.project((0, 1, 0))[0][1] < 300  # y of the world points up in the image
    assert all(f"`{key}`" in page.read_text() for key in KEYS)


@pytest.mark.parametrize("azimuth", [0, 30])
@pytest.mark.parametrize("up", [(0, 1, 0), (0, 0, 1)])
def test_framing_from_the_poles_goes_on_from_the_elevations_before(up, azimuth):
    sphere = ((1, 2, 3), 2.0)
    for pole in (90, -90):
        camera, near = (Camera.framing(sphere, azimuth, e, up) for e in (pole, pole * (1 - 1e-6)))
        np.testing.assert_allclose(camera.eye_from_world, near.eye_from_world, atol=1e-5)
        np.testing.assert_allclose(camera.project(sphere[0])[0], (256, 256), atol=1e-9)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"elevation": 91}, "elevation 91 must be between -90 and 90 degrees"),
        ({"elevation": float("nan")}, "elevation nan must be between -90 and 90 degrees"),
        ({"azimuth": float("inf")}, "azimuth inf must be finite"),
        ({"fov_y": 180}, "fov_y 180 must be between 0 and 180 degrees"),
        ({"up": (0, 0, 0)}, "up (0, 0, 0) must be a direction; it has no length"),
        ({"height": 0}, "image size 512x0 must be between 1x1 and 16384x16384"),
        ({"sphere": ((0, 0, 0), float("nan"))}, "radius nan must be finite and not negative"),
        ({"sphere": ((0, 0), 1)}, "center (0, 0) must be three finite numbers"),
    ],
)
def test_framing_names_only_what_is_wrong(changes, message):
    with pytest.raises(CameraError, match=f"^{re.escape(message)}$"):
        Camera.framing(**{"sphere": ((0, 0, 0), 1.0), **changes})
