"""Scenes with any number of splats: a sphere, and a scan whose discs are divided into smaller ones."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splatcl.prepare.voronoi import tangent_frame
from splatcl.scene.camera import Camera
from splatcl.scene.splats import Splats

SEED = 20050621
GOLDEN_ANGLE = np.pi * (3 - np.sqrt(5))
SPHERE_COVER = 0.9
"""Radius of the sphere's discs, in units of sqrt(area of the sphere / number of discs)."""
DIVIDED_COVER = 1.4
"""Radius of the k parts of a divided disc, in units of the disc's radius / sqrt(k): 1.2 would leave 25 times as many
holes in the bunny."""
BUNDLED_SCAN = Path(__file__).parents[2] / "reference_images" / "scans" / "bunny.pts"
"""Path of the scan in a checkout; an installed splatcl has none."""


def bundled_scan() -> Path | None:
    """Return the path of the scan in the checkout; None if splatcl is installed without one."""
    return BUNDLED_SCAN if BUNDLED_SCAN.exists() else None


def fibonacci_sphere(num: int) -> Splats:
    """Make `num` circular discs on the unit sphere, in a spiral from pole to pole."""
    k = np.arange(num)
    z = 1 - (2 * k + 1) / num
    ring, angle = np.sqrt(1 - z * z), k * GOLDEN_ANGLE
    center = np.stack([ring * np.cos(angle), ring * np.sin(angle), z], axis=1)
    radius = SPHERE_COVER * np.sqrt(4 * np.pi / num)
    tangent_u, tangent_v = (radius * axis for axis in tangent_frame(center))
    return _single(center, tangent_u, tangent_v, 0.5 + 0.5 * center)


def shuffled(splats: Splats) -> Splats:
    """Return the splats in a random but fixed order."""
    return splats.take(np.random.default_rng(SEED).permutation(len(splats)))


def with_field(sphere: Splats) -> Splats:
    """Return the splats of the unit sphere with its exact normal field: on it, normals change as positions do."""
    return replace(sphere, normal_du=sphere.tangent_u, normal_dv=sphere.tangent_v, on_invalid="error")


def resampled(splats: Splats, num: int) -> Splats:
    """Return `num` splats of the same surface: smaller discs spread over each disc, or fewer and larger discs.

    The parts of a disc are consecutive, so the order is as coherent as that of `splats`.
    """
    rng, num_given = np.random.default_rng(SEED), len(splats)
    parts = np.full(num_given, num // num_given)
    parts[rng.permutation(num_given)[: num % num_given]] += 1
    parent = np.repeat(np.arange(num_given), parts)
    part = np.arange(num) - np.repeat(np.cumsum(parts) - parts, parts)
    area_ratio = 1 / np.maximum(parts, 1)[parent]
    if num < num_given:
        scale = np.full(num, np.sqrt(num_given / num))
    else:
        scale = np.minimum(DIVIDED_COVER * np.sqrt(area_ratio), 1.0)
    distance = np.where(area_ratio < 1, np.sqrt((part + 0.5) * area_ratio), 0.0)
    angle = part * GOLDEN_ANGLE + rng.uniform(0, 2 * np.pi, num_given)[parent]
    u, v = (distance * f(angle) for f in (np.cos, np.sin))
    tangent_u, tangent_v = splats.tangent_u[parent], splats.tangent_v[parent]
    center = splats.center[parent] + u[:, None] * tangent_u + v[:, None] * tangent_v
    return _single(
        center, scale[:, None] * tangent_u, scale[:, None] * tangent_v, splats.color[parent], splats.oriented
    )


def frame_camera(splats: Splats, width: int, height: int) -> Camera:
    """Return the camera of every measurement; it sees all splats."""
    return Camera.framing(splats.bounding_sphere, azimuth=20, elevation=10, width=width, height=height)


def _single(
    center: NDArray[Any],
    tangent_u: NDArray[Any],
    tangent_v: NDArray[Any],
    color: NDArray[Any],
    oriented: bool = True,
) -> Splats:
    center, tangent_u, tangent_v, color = (a.astype(np.float32) for a in (center, tangent_u, tangent_v, color))
    return Splats(center, tangent_u, tangent_v, color, oriented)
