"""Light map: the sums over lights, looked up by direction on an octahedron unfolded to a square.

docs/guide/lights.md has the equations.
"""

from __future__ import annotations

import numpy as np

from splatcl.oracle.buffers import Array
from splatcl.oracle.geometry.rays import normalize
from splatcl.scene.camera import Camera
from splatcl.scene.lights import Light
from splatcl.scene.settings import RenderSettings

SIZE = 129
"""Samples along each side of the square."""


def lightmap(normal: Array, to_eye: Array, camera: Camera, settings: RenderSettings) -> tuple[Array, Array]:
    """Look up the diffuse sum at N and the specular sum at the mirror image of V, each (..., 3) linear RGB.

    `normal` is N and `to_eye` is V, unit vectors (..., 3) in eye space.
    """
    grid = np.linspace(-1, 1, SIZE)
    diffuse, specular = light_sums(_direction(np.stack(np.meshgrid(grid, grid), axis=-1)), camera, settings)
    mirrored = 2 * (normal * to_eye).sum(axis=-1, keepdims=True) * normal - to_eye
    return _bilinear(diffuse, normal), _bilinear(specular, mirrored)


def light_sums(direction: Array, camera: Camera, settings: RenderSettings) -> tuple[Array, Array]:
    """Sum over the lights for unit eye-space directions d (..., 3): a diffuse and a specular sum, each (..., 3).

    They are sum_l L_l max(d.l, 0), and sum_l L_l (d.l)^shininess over d.l > 0, with L_l the color of light l and l the
    direction toward it.
    """
    diffuse, specular = np.zeros(direction.shape), np.zeros(direction.shape)
    for light in settings.lights:
        cosine = (direction @ _toward(light, camera))[..., None]
        diffuse += np.maximum(cosine, 0) * light.color
        specular += np.where(cosine > 0, np.maximum(cosine, 0) ** settings.material.shininess, 0) * light.color
    return diffuse, specular


def _toward(light: Light, camera: Camera) -> Array:
    """Return the unit direction (3,) toward a light, eye space; a headlight's is (0, 0, -1)."""
    if light.kind == "headlight":
        return np.array([0.0, 0.0, -1.0])
    return normalize(camera.eye_from_world[:3, :3] @ light.vector)


def _direction(point: Array) -> Array:
    """Return unit vectors (..., 3) of points (..., 2) on the square [-1, 1]^2; z < 0 within |x| + |y| < 1."""
    z = np.abs(point).sum(axis=-1, keepdims=True) - 1
    return normalize(np.concatenate([np.where(z > 0, _folded(point), point), z], axis=-1))


def _on_square(direction: Array) -> Array:
    """Return the points (..., 2) on the square of vectors (..., 3)."""
    with np.errstate(invalid="ignore"):
        d = direction / np.abs(direction).sum(axis=-1, keepdims=True)
    return np.where(d[..., 2:] > 0, _folded(d[..., :2]), d[..., :2])


def _folded(point: Array) -> Array:
    """Fold points (..., 2) over the square's diagonals |x| + |y| = 1; the fold is its own inverse."""
    return (1 - np.abs(point[..., ::-1])) * np.where(point < 0, -1, 1)


def _bilinear(table: Array, direction: Array) -> Array:
    """Interpolate the table (SIZE, SIZE, 3) at directions (..., 3); a zero vector takes the first sample."""
    at = np.nan_to_num((_on_square(direction) + 1) * (SIZE - 1) / 2)
    first = np.clip(np.floor(at), 0, SIZE - 2).astype(int)
    f, g = np.moveaxis((at - first)[..., None], -2, 0)
    column, row = np.moveaxis(first, -1, 0)
    upper = (1 - f) * table[row, column] + f * table[row, column + 1]
    lower = (1 - f) * table[row + 1, column] + f * table[row + 1, column + 1]
    return (1 - g) * upper + g * lower
