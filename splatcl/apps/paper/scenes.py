"""Scenes of the experiments, and their exact images from rays and closed forms alone."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splatcl.apps.paper.metrics import box_filtered
from splatcl.apps.sample_scenes import bundled_scan, fibonacci_sphere, with_field
from splatcl.io.read import read
from splatcl.scene.camera import Camera
from splatcl.scene.splats import Splats

Array = NDArray[Any]
LIGHT, DARK = (0.85, 0.78, 0.6), (0.0, 0.12, 0.16)
"""Linear RGB of the checkerboard's squares."""
CHECK, SPACING, COVER = 0.4, 0.1, 0.8
"""Side of a square and distance of splats, scene units; radius of a splat in units of that distance."""
TOUCH = np.sqrt(0.5) * 1.001
"""Least radius, in units of the spacing, at which a square grid of discs leaves no gap."""
NO_SCAN = "Only a checkout has the bundled scan. A sphere of as many splats replaces it."


def scan() -> tuple[Splats, tuple[str, ...]]:
    """Return the bundled scan; without a checkout, return a sphere and a note."""
    path = bundled_scan()
    return (fibonacci_sphere(30_571), (NO_SCAN,)) if path is None else (read(path), ())


def painted(splats: Splats, color: Array) -> Splats:
    """Return the splats with other linear colors, (N, 3)."""
    return replace(splats, color=color, on_invalid="error")


def ramp(splats: Splats) -> Splats:
    """Return the splats with colors that change slowly from 0.1 to 1, so that bands show."""
    low, high = splats.bounds
    return painted(splats, (0.1 + 0.9 * (splats.center - low) / (high - low)).astype(np.float32))


def floor(x: tuple[float, float], z: tuple[float, float], spacing: float, radius: float) -> Splats:
    """Return a square grid of equal discs on y = 0, normals up, whose cells fill the rectangle of `x` and `z`."""
    columns, rows = (np.arange(low + spacing / 2, high, spacing) for low, high in (x, z))
    center = np.stack(np.meshgrid(columns, [0.0], rows, indexing="ij"), axis=-1).reshape(-1, 3).astype(np.float32)
    along = np.zeros_like(center)
    along[:, 2] = radius
    across = np.zeros_like(center)
    across[:, 0] = radius
    return Splats(center, along, across)


def checker_color(x: Array, z: Array) -> Array:
    """Return the (..., 3) colors of the checkerboard at positions of y = 0."""
    dark = (np.floor(x / CHECK) + np.floor(z / CHECK)) % 2 == 1
    return np.where(dark[..., None], DARK, LIGHT).astype(np.float32)


def checkerboard() -> Splats:
    """Return 51 200 splats with the colors of a checkerboard that reaches far back."""
    splats = floor((-8.0, 8.0), (-34.0, -2.0), SPACING, COVER * SPACING)
    return painted(splats, checker_color(splats.center[:, 0], splats.center[:, 2]))


def checkerboard_camera(width: int, height: int) -> Camera:
    """Return a camera that sees nothing but the checkerboard, from 20 degrees below the horizon to 2."""
    return Camera.look_at((0, 1, 0), (0, 1 - np.tan(np.radians(11)), -1), width=width, height=height, fov_y=18)


def checkerboard_truth(camera: Camera, n: int) -> Array:
    """Return the exact (H, W, 3) checkerboard: the mean of n x n rays in each pixel, without splats."""
    rows = []
    for top in range(camera.height):
        origin, direction = rays(camera, n, top)
        point = origin + direction * (-origin[1] / direction[..., 1])[..., None]
        rows.append(box_filtered(checker_color(point[..., 0], point[..., 2]), n))
    return np.concatenate(rows)


def undersampled(camera: Camera) -> Array:
    """Return (H, W) bool: where a pixel of the checkerboard is longer than two squares, so that its image is gray."""
    origin, direction = rays(camera)
    length = origin[1] / direction[..., 1] ** 2 / camera.fy  # d(z of the floor point) / d(y of the pixel)
    return length >= 2 * CHECK


def rays(camera: Camera, n: int = 1, row: int | None = None) -> tuple[Array, Array]:
    """Return the (3,) eye and the directions of a perspective camera's rays, world space; their eye-space z is 1.

    Directions are (n H, n W, 3), n x n to each pixel, or (n, n W, 3) for one row of pixels.
    """
    top, bottom = (0, camera.height) if row is None else (row, row + 1)
    y, x = np.meshgrid(top + sample(bottom - top, n), sample(camera.width, n), indexing="ij")
    eye = np.stack([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, np.ones_like(x)], axis=-1)
    return camera.position, eye @ camera.eye_from_world[:3, :3]


def sample(length: int, n: int) -> Array:
    """Return the (n length,) coordinates of n samples for each pixel, pixels."""
    return (np.arange(length * n) + 0.5) / n


NEAR_FLOOR = {"x": (-6.0, 6.0), "z": (-10.0, 0.0)}
EYE_HEIGHT, STONE = 0.25, 0.5
"""Height of the eye above the near floor, and distance of that floor's discs, scene units."""


def touching_floor() -> Splats:
    """Return discs as large as their distance from the eye, which just leave no gap, each in its own color."""
    splats = floor(NEAR_FLOOR["x"], NEAR_FLOOR["z"], STONE, TOUCH * STONE)
    return painted(splats, np.random.default_rng(4).uniform(0.2, 1, (len(splats), 3)).astype(np.float32))


def low_camera(width: int, height: int, down: float = 30.0) -> Camera:
    """Return a wide-angle camera just above the floor, turned down by `down` degrees.

    Every disc is in front of the eye plane at 30 degrees; at 20 the nearest ones reach through it.
    """
    target = 0, EYE_HEIGHT - np.tan(np.radians(down)), -1
    return Camera.look_at((0, EYE_HEIGHT, 0), target, width=width, height=height, fov_y=90)


def on_floor(camera: Camera) -> Array:
    """Return (H, W) bool: whether a pixel's ray hits the cells of `touching_floor`."""
    origin, direction = rays(camera)
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = -origin[1] / direction[..., 1]
        point = origin + direction * distance[..., None]
    low, high = np.array([NEAR_FLOOR["x"], NEAR_FLOOR["z"]]).T
    inside = (point[..., ::2] >= low) & (point[..., ::2] <= high)
    return (distance > 0) & inside.all(axis=-1)


def sphere(num: int) -> Splats:
    """Return the unit sphere with its exact linear normal field: on it the normal is the position."""
    return with_field(fibonacci_sphere(num))


def sphere_camera(width: int, height: int) -> Camera:
    """Return a camera that sees the whole unit sphere."""
    return Camera.look_at((0, 0, 4), (0, 0, 0), width=width, height=height, fov_y=32)


def sphere_truth(camera: Camera) -> tuple[Array, Array]:
    """Return the unit sphere's (H, W, 3) normals, eye space, NaN off it, and the (H, W, 3) directions to the eye."""
    origin, direction = rays(camera)
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    along = -(direction @ origin)
    with np.errstate(invalid="ignore"):
        distance = along - np.sqrt(along**2 - (origin @ origin - 1))
    rotation = camera.eye_from_world[:3, :3]
    return (origin + direction * distance[..., None]) @ rotation.T, -direction @ rotation.T
