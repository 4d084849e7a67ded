"""Scenes of any number of splats: a sphere, and a scan whose discs are divided among smaller ones."""

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
"""Radius of the sphere's discs in units of the side of a square as large as a splat's share of the surface."""
DIVIDED_COVER = 1.4
"""Radius of the k parts of a divided disc in units of 1 / sqrt(k) of its own: of the bunny's 84 000 pixels at 512x512
this opens 20, 1.2 opens 500."""
BUNDLED_SCAN = Path(__file__).parents[2] / "reference_images" / "scans" / "bunny.pts"
"""Only in a checkout."""


def bundled_scan() -> Path | None:
    """Return the scan of the checkout, None where splatcl is installed without one."""
    return BUNDLED_SCAN if BUNDLED_SCAN.exists() else None


def fibonacci_sphere(num: int) -> Splats:
    """Return `num` circular discs on the unit sphere, in a spiral from pole to pole."""
    k = np.arange(num)
    z = 1 - (2 * k + 1) / num
    ring, angle = np.sqrt(1 - z * z), k * GOLDEN_ANGLE
    center = np.stack([ring * np.cos(angle), ring * np.sin(angle), z], axis=1)
    radius = SPHERE_COVER * np.sqrt(4 * np.pi / num)
    tangent_u, tangent_v = (radius * axis for axis in tangent_frame(center))
    return _single(center, tangent_u, tangent_v, 0.5 + 0.5 * center)


def shuffled(splats: Splats) -> Splats:
    """Return the splats in a random order, always the same."""
    return splats.take(np.random.default_rng(SEED).permutation(len(splats)))


def with_field(sphere: Splats) -> Splats:
    """Return the splats of the unit sphere with linear fields of its normals, which change as positions do."""
    return replace(sphere, normal_du=sphere.tangent_u, normal_dv=sphere.tangent_v, on_invalid="error")


def resampled(splats: Splats, num: int) -> Splats:
    """Return `num` splats of the same surface: each disc's parts spread over it, or fewer and larger discs.

    The parts of a disc follow each other, so that the order is as coherent as that of `splats`.
    """
    rng, num_given = np.random.default_rng(SEED), len(splats)
    parts = np.full(num_given, num // num_given)
    parts[rng.permutation(num_given)[: num % num_given]] += 1
    parent = np.repeat(np.arange(num_given), parts)
    part = np.arange(num) - np.repeat(np.cumsum(parts) - parts, parts)
    share = 1 / np.maximum(parts, 1)[parent]
    if num < num_given:
        scale = np.full(num, np.sqrt(num_given / num))
    else:
        scale = np.minimum(DIVIDED_COVER * np.sqrt(share), 1.0)
    distance = np.where(share < 1, np.sqrt((part + 0.5) * share), 0.0)
    angle = part * GOLDEN_ANGLE + rng.uniform(0, 2 * np.pi, num_given)[parent]
    u, v = (distance * f(angle) for f in (np.cos, np.sin))
    tangent_u, tangent_v = splats.tangent_u[parent], splats.tangent_v[parent]
    center = splats.center[parent] + u[:, None] * tangent_u + v[:, None] * tangent_v
    return _single(
        center, scale[:, None] * tangent_u, scale[:, None] * tangent_v, splats.color[parent], splats.oriented
    )


def frame_camera(splats: Splats, width: int, height: int) -> Camera:
    """Return the camera of every measurement, which sees all of the splats."""
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
