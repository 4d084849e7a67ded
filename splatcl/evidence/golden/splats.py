"""Splats of the golden images, built from an integer hash with + - * / alone, in float64: the same bits everywhere."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splatcl.scene.splats import Splats

Floats = NDArray[np.float64]


def random_numbers(seed: int, *shape: int) -> Floats:
    """Return numbers in [-1, 1) of the given shape, from the SplitMix64 hash of a counter."""
    count = int(np.prod(shape))
    h = (np.arange(1, count + 1, dtype=np.uint64) + np.uint64(seed << 32)) * np.uint64(0x9E3779B97F4A7C15)
    h = (h ^ (h >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    h = (h ^ (h >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    h = h ^ (h >> np.uint64(31))
    return ((h >> np.uint64(11)).astype(np.float64) * 2.0**-52 - 1.0).reshape(shape)


def rotations(quaternion: Floats) -> Floats:
    """Return (N, 3, 3) rotations of (N, 4) quaternions of any length, by sums, products and one quotient."""
    w, x, y, z = quaternion.T
    rows = [
        [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
    ]
    return np.moveaxis(np.array(rows) / (w * w + x * x + y * y + z * z), 2, 0)


def random_discs(seed: int, count: int, half_width: float, radius: float) -> Splats:
    """Return randomly turned ellipses of radii up to `radius`, in a cube about the origin."""
    numbers = random_numbers(seed, count, 12)
    turn = rotations(numbers[:, :4] + 0.0009765625)
    radii = radius * (0.5625 + 0.4375 * numbers[:, 4:6])
    u, v = turn[:, :, 0] * radii[:, :1], turn[:, :, 1] * radii[:, 1:]
    return _splats(numbers[:, 6:9] * half_width, u, v, 0.5 + 0.5 * numbers[:, 9:12])


def edge_on() -> Splats:
    """Return discs seen edge-on: exactly, and tilted by powers of two of a radian."""
    i = np.arange(24)
    tilt = np.where(i < 4, 0.0, 2.0 ** -(i.astype(np.float64) - 3))
    center = np.stack([(i % 6) * 0.25 - 0.65625, i // 6 * 0.25 - 0.390625, np.full(24, 3.0)], axis=1)
    v = center * 0.125  # along the ray
    v[:, 1] += tilt * 0.25
    u = np.stack([np.full(24, 0.1875), np.zeros(24), np.zeros(24)], axis=1)
    return _splats(center, u, v, 0.5 + 0.5 * random_numbers(4, 24, 3))


def layers() -> Splats:
    """Return five sheets of discs that face the eye, 1/8 scene unit apart in depth, farthest first."""
    numbers = random_numbers(5, 5 * 49, 3)
    k = np.arange(5 * 49)
    center = np.stack([k % 7 * 0.25 - 0.75, k // 7 % 7 * 0.25 - 0.75, 2.5 - k // 49 * 0.125], axis=1)
    center[:, :2] += numbers[:, :2] * 0.0625
    radius = np.full(len(k), 0.21875)
    u = np.stack([radius, 0 * radius, 0 * radius], axis=1)
    v = np.stack([0 * radius, -radius, 0 * radius], axis=1)
    return _splats(center, u, v, 0.5 + 0.5 * numbers)


def tiny_discs() -> Splats:
    """Return twenty discs in front of an eye at z = 0: four of each of the five kinds that the comments name."""
    kinds = np.array(
        [
            [[0.25, 0, 3], [0.25, 0, 0.125], [0, -0.1875, 0.125]],  # tilted
            [[-0.5, 0.25, 3], [0.00390625, 0, 0], [0, -0.00390625, 0]],  # below a pixel
            [[0, -0.25, 3], [0.25, 0, 0], [0, -0.03125, 0.375]],  # edge-on
            [[0.25, 0.25, 0.75], [0.125, 0, 0.75], [0, 0.25, 0]],  # across the near plane
            [[0, 0, 3.0625], [0.5, 0, -0.25], [0.0625, 0.375, 0.125]],  # large, behind the others
        ]
    )
    discs = np.tile(kinds, (4, 1, 1))
    discs[:, 0, :2] += 0.25 * random_numbers(6, 20, 2)
    return _splats(discs[:, 0], discs[:, 1], discs[:, 2], 0.5 + 0.5 * random_numbers(7, 20, 3))


def with_field(splats: Splats) -> Splats:
    """Return the splats with linear normal fields of slopes up to 1/2."""
    du, dv = 0.5 * random_numbers(9, 2, len(splats), 3)
    return replace(splats, normal_du=du.astype(np.float32), normal_dv=dv.astype(np.float32), on_invalid="error")


def with_clip(splats: Splats) -> Splats:
    """Return the splats with one or two clip lines each; the lines cut off most of some, and nothing of others."""
    clip = random_numbers(10, len(splats), 2, 3)
    clip[:, :, 2] = 0.5 * clip[:, :, 2] + 0.25
    clip[1::2, 1] = 0
    return replace(splats, clip=clip.astype(np.float32), on_invalid="error")


def with_attributes(splats: Splats) -> Splats:
    """Return the splats with their own specular and shininess, and another attribute, height."""
    specular, shininess, height = random_numbers(11, 3, len(splats)).astype(np.float32)
    attributes = {"specular": 0.5 + 0.5 * specular, "shininess": 8.5 + 8 * shininess, "height": height}
    return replace(splats, attributes=attributes, on_invalid="error")


def _splats(*columns: Any) -> Splats:
    return Splats(*(column.astype(np.float32) for column in columns))
