"""A stand-in for the reader and the renderer, which tests the command line alone."""

from __future__ import annotations

import numpy as np
import pytest

import splatcl
from splatcl import Splats
from splatcl.cli import main
from splatcl.frame import Frame

SPLATS = Splats([[0.0, 0, 0]], [[1.0, 0, 0]], [[0.0, 1, 0]], notes=("estimated 1 normal from 8 neighbors",))


class StubRenderer:
    """A renderer that records its calls and returns a frame with a covered left half."""

    calls: list
    made: dict
    share = 0.5
    normal = (0, 0, -1)

    def __init__(self, device=None, tile_size=16, allow_inexact=False):
        type(self).made = {"device": device, "tile_size": tile_size, "allow_inexact": allow_inexact}

    def render(self, splats, camera, settings):
        type(self).calls.append((splats, camera, settings))
        color = np.zeros((camera.height, camera.width, 4), np.float32)
        color[:, : int(camera.width * self.share)] = 0.25, 0.25, 0.25, 1.0
        normal = np.full((camera.height, camera.width, 3), self.normal, np.float32)
        epsilon = 0.5 if settings.epsilon == "auto" else settings.epsilon
        return Frame({"color": color, "N": normal}, camera, settings, {"epsilon": epsilon, "device": "stub"})


@pytest.fixture
def stub(monkeypatch, tmp_path):
    """Replace the reader and the renderer; work in an empty folder."""
    StubRenderer.calls = []
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(splatcl, "Renderer", StubRenderer)
    monkeypatch.setattr("splatcl.io.read.read", lambda path, on_invalid="error": SPLATS)
    monkeypatch.setattr("splatcl.io.read.up_axis", lambda path: "z")
    return StubRenderer


def run(capsys, command):
    """Run the command in this process; return its status, lines of stdout, lines of stderr."""
    status = main(command.split())
    captured = capsys.readouterr()
    return status, captured.out.splitlines(), captured.err.splitlines()
