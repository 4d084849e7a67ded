"""Supersampling: n x n samples a pixel, drawn window by window and box-filtered (docs/guide/supersampling.md)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splatcl.scene.camera import MAX_SIZE, Camera
from splatcl.scene.settings import Shader

Aovs = Mapping[str, NDArray[Any]]
Render = Callable[[Camera, tuple[int, int]], Aovs]
"""Draws a window: the camera of its pixels, and the column and row of its first in the large image."""

MIN_SAMPLES = 1 << 16
"""Samples that a window may have however small the image is, that not too many are drawn."""
NEIGHBORS: dict[Shader, int] = {"npr": 1, "user": 8}
"""How many samples beyond its own each way a shader may look at; none where it is not named."""


@dataclass(frozen=True)
class Block:
    """Pixels of the image that are drawn together: columns [left, right) of the rows [top, bottom)."""

    left: int
    top: int
    right: int
    bottom: int


def supersampled(
    camera: Camera, n: int, render: Render, margin: int = 0, samples: int | None = None
) -> dict[str, NDArray[Any]]:
    """Return the AOVs of `camera`'s image, of n x n samples a pixel.

    Parameters
    ----------
    camera : Camera
        Of the image.
    n : int
        Samples along a pixel's side.
    render : function
        Returns a window's AOVs, each (H, W) or (H, W, channels); its camera has its size, and the large image's focal
        lengths and principal point.
    margin : int
        Samples to draw around a block and cut off before filtering, for shaders that look at neighbours.
    samples : int, optional
        About how many a window may have; as many as the image has pixels, or MIN_SAMPLES if those are more, by
        default. Changes memory and speed, never a bit.

    Returns
    -------
    dict of str to array
        Each (height, width) or (height, width, channels), of the type that `render` gave.
    """
    image: dict[str, NDArray[Any]] = {}
    samples = max(MIN_SAMPLES, camera.width * camera.height) if samples is None else samples
    for block in blocks(camera, n, margin, samples):
        for name, values in _drawn(camera, n, render, margin, block).items():
            if name not in image:
                image[name] = np.empty((camera.height, camera.width, *values.shape[2:]), values.dtype)
            image[name][block.top : block.bottom, block.left : block.right] = values
    return image


def blocks(camera: Camera, n: int, margin: int, samples: int) -> Iterator[Block]:
    """Cut the image into blocks of about `samples` samples at most: whole rows, or parts of one that has too many."""
    longest = max((MAX_SIZE - 2 * margin) // n, 1)
    pixels = max(samples // n**2, 1)
    columns = min(camera.width, pixels, longest)
    rows = min(camera.height, pixels // columns, longest)
    for top in range(0, camera.height, rows):
        for left in range(0, camera.width, columns):
            yield Block(left, top, min(left + columns, camera.width), min(top + rows, camera.height))


def _drawn(camera: Camera, n: int, render: Render, margin: int, block: Block) -> dict[str, NDArray[Any]]:
    """Return a block's pixels. What its samples took is free when this returns, for the next."""
    left, top = max(n * block.left - margin, 0), max(n * block.top - margin, 0)
    right, bottom = (
        min(n * end + margin, n * size) for end, size in ((block.right, camera.width), (block.bottom, camera.height))
    )
    window = replace(
        camera, fx=n * camera.fx, fy=n * camera.fy, cx=n * camera.cx, cy=n * camera.cy, width=right - left,
        height=bottom - top,
    )  # fmt: skip
    rows = slice(n * block.top - top, n * block.bottom - top)
    columns = slice(n * block.left - left, n * block.right - left)
    drawn = render(window, (left, top))
    return box_filtered({name: drawn[name][rows, columns] for name in drawn}, n)


def box_filtered(samples: Aovs, n: int) -> dict[str, NDArray[Any]]:
    """Return pixels made of n x n samples each.

    Parameters
    ----------
    samples : mapping of str to array
        The AOVs of `Frame`, (n height, n width) or (n height, n width, channels).
    n : int

    Returns
    -------
    dict of str to array
        (height, width) or (height, width, channels), of the same types. Sums are in float64, each pixel's columns
        from top to bottom first and then their sums from left to right; they are rounded to the AOV's type at the end.
    """
    return {name: _filtered(name, samples, n).astype(samples[name].dtype) for name in samples}


def _filtered(name: str, samples: Aovs, n: int) -> NDArray[Any]:
    """Return the AOV `name` of the pixels; which rule each follows is in docs/guide/supersampling.md."""
    values = samples[name]
    if name == "Z":
        return _least(values, n)
    if name == "particleid":
        nearest = np.repeat(np.repeat(_least(samples["Z"], n), n, axis=0), n, axis=1)
        return _least(np.where(samples["Z"] == nearest, values, np.iinfo(values.dtype).max), n)
    if name == "count":
        return np.minimum(_sum(values, n), np.iinfo(values.dtype).max)
    if name in ("color", "weight"):
        return _sum(values, n) / n**2
    if name.startswith("depth."):
        there = np.isfinite(values)
        return np.where(_sum(there, n) > 0, _mean(np.where(there, values, 0), there, n), np.inf)
    mean = _mean(values, samples["weight"] > 0, n)
    return _normalized(mean) if name == "N" else mean


def _sum(values: NDArray[Any], n: int) -> NDArray[np.float64]:
    """Return the sums over n x n samples, in an order that no window and no library changes."""
    rows = values.reshape(-1, n, *values.shape[1:])
    down = rows[:, 0].astype(np.float64)
    for i in range(1, n):
        down += rows[:, i]
    columns = down.reshape(len(down), -1, n, *values.shape[2:])
    across = columns[:, :, 0].copy()
    for i in range(1, n):
        across += columns[:, :, i]
    return across


def _mean(values: NDArray[Any], there: NDArray[np.bool_], n: int) -> NDArray[np.float64]:
    """Return the mean over those of n x n samples that are `there`, (H, W) bool; 0 where none is, as all others are."""
    number = np.maximum(_sum(there, n), 1)
    return _sum(values, n) / number.reshape(*number.shape, *(1,) * (values.ndim - 2))


def _least(values: NDArray[Any], n: int) -> NDArray[Any]:
    height, width = values.shape
    least: NDArray[Any] = values.reshape(height // n, n, width // n, n).min(axis=(1, 3))
    return least


def _normalized(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (H, W, 3) unit vectors; one without a length is zero."""
    x, y, z = np.moveaxis(vectors, -1, 0)
    length = np.sqrt((x * x + y * y) + z * z)[..., None]
    return vectors / np.where(length > 0, length, 1.0)
