"""Solids of planes, spheres and tubes, combined with ``|``, ``&`` and ``-`` (constructive solid geometry)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from splatcl.errors import SettingsError
from splatcl.scene.camera import vector
from splatcl.scene.splats import DEFAULT_COLOR

Array = NDArray[Any]
Flags = Sequence[Any]
"""One entry for each surface of a solid: whether a point is inside of it; a bool or an array of bools."""
Discs = tuple[Array, Array, Array]
"""Centers and tangents, (N, 3) float64, world space; the normal u x v points out of the surface."""
OVERLAP = 1.05
"""Ratio of a disc's size to the least size that covers its part of a surface."""


@dataclass(frozen=True, eq=False)
class Surface:
    """A plane, a sphere or an endless tube, and the discs that cover its primitive's part of it."""

    nearest: Callable[[Array], tuple[Array, Array]]
    """(N, 3) points -> (N,) distances, negative inside, and (N, 3) unit normals at the nearest surface points."""
    discs: Callable[[float], Discs]
    """Spacing, scene units -> discs."""
    color: Array
    """(3,) linear RGB of the splats."""


@dataclass(frozen=True, eq=False)
class Solid:
    """The inside of a combination of surfaces; ``a | b``, ``a & b`` and ``a - b`` combine solids."""

    surfaces: tuple[Surface, ...]
    """The surfaces of all primitives."""
    contains: Callable[[Flags], Any]
    """Flags of a point, inside or outside of each surface -> whether the solid contains the point."""

    def __or__(self, other: Solid) -> Solid:
        return self._joined(other, lambda a, b: a | b)

    def __and__(self, other: Solid) -> Solid:
        return self._joined(other, lambda a, b: a & b)

    def __sub__(self, other: Solid) -> Solid:
        return self._joined(other, lambda a, b: a > b)

    def _joined(self, other: Solid, join: Callable[[Any, Any], Any]) -> Solid:
        num = len(self.surfaces)
        return Solid(
            self.surfaces + other.surfaces,
            lambda flags: join(self.contains(flags[:num]), other.contains(flags[num:])),
        )

    def inside(self, points: ArrayLike) -> Array:
        """Return (N,) bool: whether the solid contains the (N, 3) points, world space."""
        array = np.asarray(points, np.float64)
        flags: Array = self.contains([surface.nearest(array)[0] <= 0 for surface in self.surfaces])
        return flags


def box(center: ArrayLike, size: ArrayLike, color: ArrayLike = DEFAULT_COLOR) -> Solid:
    """Make a box with edges along the axes.

    Parameters
    ----------
    center : (3,) float
        World space.
    size : (3,) float
        Lengths of the edges, scene units.
    color : (3,) float
        Linear RGB of the splats.

    Raises
    ------
    SettingsError
        An argument is not three finite numbers, or a length is not positive.
    """
    middle, half, rgb = _vector("center", center), 0.5 * _vector("size", size), _vector("color", color)
    _positive("size", *half)
    surfaces = []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            normal = sign * np.eye(3)[axis]
            u, v = np.roll(np.eye(3), -axis, axis=0)[[1, 2]] * np.roll(half, -axis)[1:, None]
            surfaces.append(_plane(middle + half[axis] * normal, u, v if sign > 0 else -v, rgb))
    return Solid(tuple(surfaces), _all)


def sphere(center: ArrayLike, radius: float, color: ArrayLike = DEFAULT_COLOR) -> Solid:
    """Make a ball.

    Parameters
    ----------
    center : (3,) float
        World space.
    radius : float
        Scene units.
    color : (3,) float
        Linear RGB of the splats.

    Raises
    ------
    SettingsError
        `center` or `color` is not three finite numbers, or `radius` is not positive.
    """
    middle, rgb = _vector("center", center), _vector("color", color)
    _positive("radius", radius)

    def nearest(points: Array) -> tuple[Array, Array]:
        apart = points - middle
        distance = np.linalg.norm(apart, axis=1)
        return distance - radius, _unit(apart, distance, np.array([0.0, 0.0, 1.0]))

    def discs(spacing: float) -> Discs:
        rows = _steps(np.pi * radius, spacing, 3)
        height = np.pi / rows
        latitude = height * (np.arange(rows) + 0.5) - np.pi / 2
        widest = np.cos(np.maximum(np.abs(latitude) - height / 2, 0.0))
        columns = np.maximum(np.ceil(2 * np.pi * radius * widest / spacing), 4).astype(np.intp)
        lat, width = np.repeat(latitude, columns), np.repeat(2 * np.pi / columns, columns)
        lon = width * (np.arange(len(lat)) - np.repeat(np.cumsum(columns) - columns, columns))
        # A cell's farthest point is a corner. Seen from the sphere's center, the disc's rim passes through it.
        cosine = np.min(
            [
                np.sin(lat) * np.sin(lat + s) + np.cos(lat) * np.cos(lat + s) * np.cos(width / 2)
                for s in (-height / 2, height / 2)
            ],
            axis=0,
        )
        size = OVERLAP * radius * np.sqrt(1 / cosine**2 - 1)[:, None]
        normal = np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], axis=1)
        east = np.stack([-np.sin(lon), np.cos(lon), np.zeros(len(lon))], axis=1)
        return middle + radius * normal, size * east, size * np.cross(normal, east)

    return Solid((Surface(nearest, discs, rgb),), _all)


def cylinder(start: ArrayLike, end: ArrayLike, radius: float, color: ArrayLike = DEFAULT_COLOR) -> Solid:
    """Make a round cylinder.

    Parameters
    ----------
    start, end : (3,) float
        Centers of the two ends, world space.
    radius : float
        Scene units.
    color : (3,) float
        Linear RGB of the splats.

    Raises
    ------
    SettingsError
        `start`, `end` or `color` is not three finite numbers, or `radius` or the length is not positive.
    """
    bottom, top, rgb = _vector("start", start), _vector("end", end), _vector("color", color)
    length = float(np.linalg.norm(top - bottom))
    _positive("radius", radius)
    _positive("the distance from start to end", length)
    axis = (top - bottom) / length
    x = np.cross(axis, np.eye(3)[np.abs(axis).argmin()])
    x /= np.linalg.norm(x)
    y = np.cross(axis, x)

    def nearest(points: Array) -> tuple[Array, Array]:
        apart = points - bottom
        apart -= (apart @ axis)[:, None] * axis
        distance = np.linalg.norm(apart, axis=1)
        return distance - radius, _unit(apart, distance, x)

    def discs(spacing: float) -> Discs:
        around, along = _steps(2 * np.pi * radius, spacing, 4), _steps(length, spacing, 1)
        angle = np.repeat(2 * np.pi / around * np.arange(around), along)[:, None]
        height = np.tile(length / along * (np.arange(along) + 0.5), around)[:, None]
        normal, east = np.cos(angle) * x + np.sin(angle) * y, np.cos(angle) * y - np.sin(angle) * x
        wide = OVERLAP * np.sqrt(2) * radius * np.tan(np.pi / around)
        high = OVERLAP * np.sqrt(2) * 0.5 * length / along
        return bottom + height * axis + radius * normal, wide * east, np.broadcast_to(high * axis, normal.shape)

    caps = (_plane(top, radius * x, radius * y, rgb), _plane(bottom, radius * x, -radius * y, rgb))
    return Solid((Surface(nearest, discs, rgb), *caps), _all)


def _plane(center: Array, u: Array, v: Array, color: Array) -> Surface:
    """Make a plane with the normal u x v; its discs cover the rectangle center +- u +- v."""
    normal = np.cross(u, v)
    normal /= np.linalg.norm(normal)

    def nearest(points: Array) -> tuple[Array, Array]:
        return (points - center) @ normal, np.broadcast_to(normal, points.shape)

    def discs(spacing: float) -> Discs:
        wide, high = (_steps(2 * float(np.linalg.norm(t)), spacing, 1) for t in (u, v))
        a, b = ((2 * np.arange(n) + 1) / n - 1 for n in (wide, high))
        grid = np.stack(np.meshgrid(a, b, indexing="ij"), axis=-1).reshape(-1, 2)
        centers = center + grid[:, :1] * u + grid[:, 1:] * v
        size = OVERLAP * np.sqrt(2)
        return centers, np.broadcast_to(size / wide * u, centers.shape), np.broadcast_to(size / high * v, centers.shape)

    return Surface(nearest, discs, color)


def _all(flags: Flags) -> Any:
    """Return whether all flags are set: the inside of a convex primitive."""
    inside = flags[0]
    for flag in flags[1:]:
        inside = inside & flag
    return inside


def _steps(length: float, spacing: float, least: int) -> int:
    """Return the number of steps of at most `spacing` along a length, at least `least`."""
    return max(int(np.ceil(length / spacing)), least)


def _unit(vectors: Array, length: Array, otherwise: Array) -> Array:
    """Divide vectors by their lengths; return `otherwise` for a vector of length 0."""
    return np.where(length[:, None] > 0, vectors / np.where(length > 0, length, 1.0)[:, None], otherwise)


def _vector(name: str, value: ArrayLike) -> Array:
    return vector(name, value, SettingsError)


def _positive(name: str, *values: float) -> None:
    for value in values:
        if not 0 < value < np.inf:
            raise SettingsError(f"{name} must be positive and finite, not {value}")
