"""Fixtures: one device and one renderer of each kind for the whole session."""

from __future__ import annotations

from functools import cache

import pytest


@pytest.fixture(scope="session")
def device():
    from splatcl.device import DeviceQueue

    return DeviceQueue()


@pytest.fixture(scope="session")
def renderer_with():
    """Return `renderer_with(lanes=, tile_size=)`, which keeps each renderer it makes."""
    from splatcl import Renderer

    return cache(lambda lanes=None, tile_size=16: Renderer(lanes=lanes, tile_size=tile_size))


@pytest.fixture(scope="session")
def renderer(renderer_with):
    return renderer_with()
