"""Supersampling: n x n samples per pixel, drawn window by window and box-filtered (docs/guide/supersampling.md)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splatcl.scene.camera import MAX_SIZE, Camera
from splatcl.scene.settings import Shader

Aovs = Mapping[str, NDArray[Any]]
DrawWindow = Callable[[Camera, tuple[int, int]], Aovs]
"""Draws a window of the image of samples, from its camera and the column and row of its first sample."""

MIN_SAMPLES = 1 << 16
"""Least limit on a window's samples; it keeps the windows of a small image few."""
NEIGHBORS: dict[Shader, int] = {"npr": 1, "user": 8}
"""Distance in samples up to which a shader reads neighbors; 0 for other shaders."""


@dataclass(frozen=True)
class Block:
    """Pixels of the image that one window draws: columns [left, right) of the rows [top, bottom)."""

    left: int
    top: int
    right: int
    bottom: int


def supersampled(
    camera: Camera, n: int, render: DrawWindow, margin: int = 0, samples: int | None = None
) -> dict[str, NDArray[Any]]:
    """Return the AOVs of `camera`'s image, from n x n samples per pixel.

    Parameters
    ----------
    camera : Camera
        Camera of the image.
    n : int
        Samples per axis of a pixel.
    render : function
        Returns a window's AOVs, each (H, W) or (H, W, channels). The window's camera has the window's size, and the
        focal lengths and principal point of the image of samples.
    margin : int
        Samples to draw around a block and cut off before filtering, for shaders that read neighbors.
    samples : int, optional
        Approximate limit on a window's samples. The default is the image's number of pixels, but at least MIN_SAMPLES.
        The limit changes memory and speed, never a bit.

    Returns
    -------
    dict of str to array
        Each (height, width) or (height, width, channels), of the dtype that `render` returns.
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
    """Cut the image into blocks of about `samples` samples at most: whole rows, or parts of one long row."""
    longest = max((MAX_SIZE - 2 * margin) // n, 1)
    pixels = max(samples // n**2, 1)
    columns = min(camera.width, pixels, longest)
    rows = min(camera.height, pixels // columns, longest)
    for top in range(0, camera.height, rows):
        for left in range(0, camera.width, columns):
            yield Block(left, top, min(left + columns, camera.width), min(top + rows, camera.height))


def _drawn(camera: Camera, n: int, render: DrawWindow, margin: int, block: Block) -> dict[str, NDArray[Any]]:
    """Return a block's pixels. The samples' memory is free again when this returns."""
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
    """Return the pixels of n x n samples each.

    Parameters
    ----------
    samples : mapping of str to array
        AOVs of `Frame`, (n height, n width) or (n height, n width, channels).
    n : int
        Samples per axis of a pixel.

    Returns
    -------
    dict of str to array
        (height, width) or (height, width, channels), of the same dtypes. Sums are in float64: each pixel's columns
        from top to bottom, then the columns' sums from left to right. The AOV's dtype rounds only the result.
    """
    return {name: _filtered(name, samples, n).astype(samples[name].dtype) for name in samples}


def _filtered(name: str, samples: Aovs, n: int) -> NDArray[Any]:
    """Return the AOV `name` of the pixels. docs/guide/supersampling.md has the rule of each AOV."""
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
        finite = np.isfinite(values)
        return np.where(_sum(finite, n) > 0, _mean(np.where(finite, values, 0), finite, n), np.inf)
    mean = _mean(values, samples["weight"] > 0, n)
    return _normalized(mean) if name == "N" else mean


def _sum(values: NDArray[Any], n: int) -> NDArray[np.float64]:
    """Return each pixel's sum over n x n samples. Neither the window nor NumPy changes the order of the sum."""
    rows = values.reshape(-1, n, *values.shape[1:])
    down = rows[:, 0].astype(np.float64)
    for i in range(1, n):
        down += rows[:, i]
    columns = down.reshape(len(down), -1, n, *values.shape[2:])
    across = columns[:, :, 0].copy()
    for i in range(1, n):
        across += columns[:, :, i]
    return across


def _mean(values: NDArray[Any], valid: NDArray[np.bool_], n: int) -> NDArray[np.float64]:
    """Return each pixel's mean over the samples where `valid`, (H, W) bool, is true; 0 for a pixel without any.

    `values` must be 0 at the other samples.
    """
    number = np.maximum(_sum(valid, n), 1)
    return _sum(values, n) / number.reshape(*number.shape, *(1,) * (values.ndim - 2))


def _least(values: NDArray[Any], n: int) -> NDArray[Any]:
    height, width = values.shape
    least: NDArray[Any] = values.reshape(height // n, n, width // n, n).min(axis=(1, 3))
    return least


def _normalized(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (H, W, 3) unit vectors; a zero vector stays zero."""
    x, y, z = np.moveaxis(vectors, -1, 0)
    length = np.sqrt((x * x + y * y) + z * z)[..., None]
    return vectors / np.where(length > 0, length, 1.0)
