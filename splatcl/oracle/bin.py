"""Bin: list the splats that may touch each tile."""

from __future__ import annotations

import numpy as np

from splatcl.oracle.buffers import Array, ProjectedSplats
from splatcl.scene.camera import Camera


def bin(projected: ProjectedSplats, camera: Camera, tile_size: int) -> list[Array]:
    """Return for each tile, in row-major order, the increasing int64 indices of the splats whose bounds reach it.

    Bounds reach a tile where they overlap the box of its pixel centers, edges included. `tile_size` is in pixels.
    """
    x_min, y_min, x_max, y_max = projected.bounds.T
    tiles = []
    for y in range(0, camera.height, tile_size):
        for x in range(0, camera.width, tile_size):
            x_last, y_last = min(x + tile_size, camera.width) - 1, min(y + tile_size, camera.height) - 1
            inside_x = (x_max >= x + 0.5) & (x_min <= x_last + 0.5)
            inside_y = (y_max >= y + 0.5) & (y_min <= y_last + 0.5)
            tiles.append(np.flatnonzero(inside_x & inside_y))
    return tiles
