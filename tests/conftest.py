"""Fixtures: one device and one renderer of each kind for the session, and a stand-in for the OpenGL backend."""

from __future__ import annotations

from functools import cache

import pytest

STUB = """
import time
import numpy as np
class Backend:
    renderer_name = "stub"
    def __init__(self, splats, sort=True): self.num, self.drawn = len(splats), 0
    def draw(self, camera, settings): self.drawn += 1; self.size = camera.height, camera.width
    def read(self): return {"color": np.ones((*self.size, 4), np.float32)}
"""


THIRDS = ("1", "2", "3")


def pytest_addoption(parser):
    parser.addoption("--slow-third", choices=THIRDS, help="leave out the slow tests of the two other thirds")


def pytest_collection_modifyitems(config, items):
    """Deal the slow tests to the thirds in turn, so that each gets its share of every sweep."""
    if (third := config.getoption("--slow-third")) is None:
        return
    slow = [item for item in items if item.get_closest_marker("slow")]
    kept = set(slow[THIRDS.index(third) :: len(THIRDS)])
    others = [item for item in slow if item not in kept]
    config.hook.pytest_deselected(items=others)
    items[:] = [item for item in items if item not in set(others)]


@pytest.fixture(scope="session")
def device():
    from splatcl.opencl.device.strictness import Device

    return Device()


@pytest.fixture(scope="session")
def renderer_with():
    """Return `renderer_with(lanes=, tile_size=)`, which keeps each renderer that it makes."""
    from splatcl import Renderer

    return cache(lambda lanes=None, tile_size=16: Renderer(lanes=lanes, tile_size=tile_size))


@pytest.fixture(scope="session")
def renderer(renderer_with):
    return renderer_with()


@pytest.fixture
def stub_backend(monkeypatch, tmp_path):
    """Replace the OpenGL backend by a stub; return its file."""
    from splatcl.apps.bench import against

    path = tmp_path / "backend.py"
    path.write_text(STUB)
    monkeypatch.setattr(against, "BACKEND", path)
    return path
