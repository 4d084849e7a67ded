"""The light map: lights looked up by direction on an octahedron that is unfolded to a square (docs/guide/lights.md)."""

from __future__ import annotations

import numpy as np

from splatcl.oracle.rays import Array, _normalize
from splatcl.scene.camera import Camera
from splatcl.scene.lights import Light
from splatcl.scene.settings import RenderSettings

SIZE = 129
"""Samples each way."""


def lightmap(normal: Array, to_eye: Array, camera: Camera, settings: RenderSettings) -> tuple[Array, Array]:
    """(..., 3) the light that arrives at `normal`, and that which is mirrored `to_eye`; unit vectors (..., 3)."""
    grid = np.linspace(-1, 1, SIZE)
    diffuse, specular = gathered(_direction(np.stack(np.meshgrid(grid, grid), axis=-1)), camera, settings)
    mirrored = 2 * (normal * to_eye).sum(axis=-1, keepdims=True) * normal - to_eye
    return _bilinear(diffuse, normal), _bilinear(specular, mirrored)


def gathered(direction: Array, camera: Camera, settings: RenderSettings) -> tuple[Array, Array]:
    """(..., 3) sum L max(d.L, 0) and sum L (d.L)^shininess over d.L > 0, of unit eye-space directions (..., 3)."""
    diffuse, specular = np.zeros(direction.shape), np.zeros(direction.shape)
    for light in settings.lights:
        cosine = (direction @ _toward(light, camera))[..., None]
        diffuse += np.maximum(cosine, 0) * light.color
        specular += np.where(cosine > 0, np.maximum(cosine, 0) ** settings.material.shininess, 0) * light.color
    return diffuse, specular


def _toward(light: Light, camera: Camera) -> Array:
    if light.kind == "headlight":
        return np.array([0.0, 0.0, -1.0])
    return _normalize(camera.eye_from_world[:3, :3] @ light.vector)


def _direction(place: Array) -> Array:
    """(..., 3) unit vectors of places (..., 2) on the square: z < 0 within |x| + |y| < 1, the rest folded out."""
    z = np.abs(place).sum(axis=-1, keepdims=True) - 1
    return _normalize(np.concatenate([np.where(z > 0, _folded(place), place), z], axis=-1))


def _place(direction: Array) -> Array:
    """(..., 2) where vectors (..., 3) are on the square."""
    with np.errstate(invalid="ignore"):
        d = direction / np.abs(direction).sum(axis=-1, keepdims=True)
    return np.where(d[..., 2:] > 0, _folded(d[..., :2]), d[..., :2])


def _folded(place: Array) -> Array:
    return (1 - np.abs(place[..., ::-1])) * np.where(place < 0, -1, 1)


def _bilinear(table: Array, direction: Array) -> Array:
    at = np.nan_to_num((_place(direction) + 1) * (SIZE - 1) / 2)
    first = np.clip(np.floor(at), 0, SIZE - 2).astype(int)
    f, g = np.moveaxis((at - first)[..., None], -2, 0)
    column, row = np.moveaxis(first, -1, 0)
    upper = (1 - f) * table[row, column] + f * table[row, column + 1]
    lower = (1 - f) * table[row + 1, column] + f * table[row + 1, column + 1]
    return (1 - g) * upper + g * lower
