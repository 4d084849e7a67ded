"""Frame: AOVs by name, lazily; pickling; showing itself."""

from __future__ import annotations

import pickle
from collections.abc import Mapping

import numpy as np
import pytest

from splatcl import Camera, RenderSettings, SplatclError
from splatcl.errors import FileError
from splatcl.frame import Frame


class Lazy(Mapping):
    """A mapping that counts its computations."""

    def __init__(self, arrays):
        self.arrays, self.computed = arrays, []

    def __getitem__(self, name):
        self.computed.append(name)
        return self.arrays[name]

    def __iter__(self):
        return iter(self.arrays)

    def __len__(self):
        return len(self.arrays)


def make_frame(height=2, width=3):
    camera = Camera.look_at((0, 0, 3), (0, 0, 0), width=width, height=height)
    aovs = Lazy(
        {
            "color": np.full((height, width, 4), 0.5, np.float32),
            "Z": np.full((height, width), np.inf, np.float32),
            "count": np.arange(height * width, dtype=np.uint32).reshape(height, width),
        }
    )
    return Frame(aovs, camera, RenderSettings(), {"epsilon": 0.25}), aovs


def test_aovs_are_computed_only_when_asked_for():
    frame, aovs = make_frame()
    assert list(frame) == ["color", "Z", "count"] == list(frame.keys())
    assert "Z" in frame and "N" not in frame and len(frame) == 3
    assert aovs.computed == []
    assert frame["Z"].shape == (2, 3) and frame.color.shape == (2, 3, 4)
    assert aovs.computed == ["Z", "color"]
    assert (frame.width, frame.height) == (3, 2)


def test_an_unknown_aov_names_the_choices():
    frame, _ = make_frame()
    with pytest.raises(SplatclError, match="the frame has no AOV 'depth'; it has color, Z, count"):
        frame["depth"]


def test_repr_says_size_and_aovs_and_computes_nothing():
    frame, aovs = make_frame()
    assert repr(frame) == "<Frame 3x2: color, Z, count>"
    assert aovs.computed == []


def test_pickle_keeps_every_array_camera_and_settings():
    frame, _ = make_frame()
    copy = pickle.loads(pickle.dumps(frame))
    assert list(copy) == list(frame) and type(copy._aovs) is dict
    for name in frame:
        np.testing.assert_array_equal(copy[name], frame[name])
        assert copy[name].dtype == frame[name].dtype
    np.testing.assert_array_equal(copy.camera.eye_from_world, frame.camera.eye_from_world)
    assert copy.settings == frame.settings and copy.metadata == {"epsilon": 0.25}


def test_a_frame_converts_to_a_dict():
    frame, _ = make_frame()
    assert sorted(dict(frame)) == ["Z", "color", "count"]


def test_a_notebook_gets_a_png():
    import imageio.v3 as iio

    frame, _ = make_frame()
    assert iio.imread(frame._repr_png_(), extension=".png").shape == (2, 3, 4)


@pytest.mark.parametrize("name", ["out.jpg", "out", "out.exr.gz", "png"])
def test_save_to_an_unknown_format_is_an_error_and_leaves_nothing(tmp_path, name):
    frame, _ = make_frame()
    with pytest.raises(FileError, match=r"use \.exr or \.png"):
        frame.save(tmp_path / name)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["out.png", "OUT.PNG", "out.exr", "Out.EXR"])
def test_save_chooses_the_format_by_extension(tmp_path, name):
    frame, _ = make_frame()
    frame.save(tmp_path / name)
    magic = b"\x89PNG" if name.lower().endswith("png") else b"\x76\x2f\x31\x01"
    assert (tmp_path / name).read_bytes()[:4] == magic
    assert [p.name for p in tmp_path.iterdir()] == [name]


def test_exposure_is_refused_for_exr(tmp_path):
    frame, _ = make_frame()
    with pytest.raises(SplatclError, match="exposure"):
        frame.save(tmp_path / "a.exr", exposure=1.0)
