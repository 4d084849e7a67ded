"""Camera: the spaces of the specification, and the maps between them.

World space -> eye space (x right, y down, z forward: the OpenCV axes) -> raster space (pixels, x right, y down).
The origin of raster space is the image's upper left corner; pixel (i, j) has its center at (i + 1/2, j + 1/2).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from splatcl.errors import CameraError, SplatclError
from splatcl.scene.splats import MAX_MAGNITUDE

Projection = Literal["perspective", "orthographic"]
MAX_SIZE = 16384
"""Largest width and height of an image, pixels."""
RIGID_TOLERANCE = 1e-4
"""Largest entry of |R R^T - I| for the rotation R of `eye_from_world`; files write matrices with few digits."""
POLE = 1e-6
"""Cosine of an elevation; below it, `Camera.framing` takes `up` as parallel to the view."""


@dataclass(frozen=True, eq=False)
class Camera:
    """A pinhole or orthographic camera.

    Parameters
    ----------
    eye_from_world : (4, 4) float array
        Rigid transform from world to eye space, row-major, acts on column vectors.
    fx, fy : float
        Focal lengths: pixels (perspective, x = fx X/Z + cx) or pixels per scene unit (orthographic, x = fx X + cx).
    cx, cy : float
        Principal point, pixels from the image's upper left corner.
    width, height : int
        Image size, pixels.
    near, far : float
        Visible range of eye-space z, scene units, both ends included; a perspective camera needs ``near > 0``.
    projection : {"perspective", "orthographic"}

    Raises
    ------
    CameraError
        The transform is not rigid, or a number is out of its range.
    """

    eye_from_world: NDArray[np.float64]
    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int
    near: float = 1e-3
    far: float = float("inf")
    projection: Projection = "perspective"

    def __post_init__(self) -> None:
        try:
            matrix = np.array(self.eye_from_world, dtype=np.float64)
            for name in ("fx", "fy", "cx", "cy", "near", "far"):
                object.__setattr__(self, name, float(getattr(self, name)))
            for name in ("width", "height"):
                if int(getattr(self, name)) != getattr(self, name):
                    raise ValueError(f"{name} {getattr(self, name)!r} must be a whole number")
                object.__setattr__(self, name, int(getattr(self, name)))
        except (TypeError, ValueError, OverflowError) as error:
            raise CameraError(f"camera: {error}") from None
        matrix.setflags(write=False)
        object.__setattr__(self, "eye_from_world", matrix)
        self._validate()

    def _validate(self) -> None:
        matrix = self.eye_from_world
        if matrix.shape != (4, 4) or not (np.abs(matrix) <= MAX_MAGNITUDE).all():
            raise CameraError(f"eye_from_world has shape {matrix.shape}; it must be (4, 4), numbers of at most 1e15")
        rotation = matrix[:3, :3]
        off = np.abs(rotation @ rotation.T - np.eye(3)).max()
        if off > RIGID_TOLERANCE or np.linalg.det(rotation) < 0 or not np.array_equal(matrix[3], [0, 0, 0, 1]):
            raise CameraError(
                f"eye_from_world is not a rotation and a translation (R R^T is off by {off:.1e}, "
                f"det {np.linalg.det(rotation):.3f}); remove scale, mirroring and perspective from it"
            )
        _check_size(self.width, self.height)
        if not (0 < self.fx < 1e9 and 0 < self.fy < 1e9):
            raise CameraError(f"focal lengths must be positive and below 1e9, not fx {self.fx}, fy {self.fy}")
        if not (abs(self.cx) < 1e9 and abs(self.cy) < 1e9):
            raise CameraError(f"principal point ({self.cx}, {self.cy}) must be finite")
        if self.projection not in ("perspective", "orthographic"):
            raise CameraError(f"projection {self.projection!r} must be 'perspective' or 'orthographic'")
        if not self.near < self.far or not np.isfinite(self.near):
            raise CameraError(f"near {self.near} must be finite and below far {self.far}")
        if self.projection == "perspective" and self.near <= 0:
            raise CameraError(f"near {self.near} must be positive for a perspective camera")

    @property
    def position(self) -> NDArray[np.float64]:
        """(3,) float64 eye position, world space."""
        return -self.eye_from_world[:3, :3].T @ self.eye_from_world[:3, 3]

    def project(self, points: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Project points from world space to raster space.

        Parameters
        ----------
        points : (..., 3) float array
            World space.

        Returns
        -------
        raster : (..., 2) float64 array
            Raster space, pixels; NaN or infinite where a perspective point has z = 0.
        z : (...) float64 array
            Eye-space depth, scene units; negative behind the eye.
        """
        eye = np.asarray(points, np.float64) @ self.eye_from_world[:3, :3].T + self.eye_from_world[:3, 3]
        z = eye[..., 2]
        with np.errstate(divide="ignore", invalid="ignore"):
            image = eye[..., :2] / z[..., None] if self.projection == "perspective" else eye[..., :2]
        return image * (self.fx, self.fy) + (self.cx, self.cy), z

    @classmethod
    def look_at(
        cls,
        eye: ArrayLike,
        target: ArrayLike,
        up: ArrayLike = (0.0, 1.0, 0.0),
        fov_y: float = 45.0,
        width: int = 512,
        height: int = 512,
        **kwargs: Any,
    ) -> Camera:
        """Make a camera at `eye` that looks at `target`.

        Parameters
        ----------
        eye, target : (3,) float
            Points, world space.
        up : (3,) float
            World-space direction that points up in the image.
        fov_y : float
            Full vertical angle of view, degrees. An orthographic camera gets the height that a perspective camera
            sees at the target.
        width, height : int
            Image size, pixels.
        **kwargs
            `near`, `far`, `projection` of `Camera`.

        Raises
        ------
        CameraError
            `eye` equals `target`, `up` is parallel to the view, or a number is out of its range.
        """
        position, upward = vector("eye", eye), vector("up", up)
        forward = vector("target", target) - position
        distance = np.linalg.norm(forward)
        right = np.cross(forward, upward)
        if not distance > 0 or not np.linalg.norm(right) > 1e-9 * distance * np.linalg.norm(upward):
            raise CameraError(
                f"look_at: eye {eye!r} and target {target!r} must differ, and up {up!r} must not be along the view"
            )
        _check_fov(fov_y)
        z = forward / distance
        x = right / np.linalg.norm(right)
        matrix = np.eye(4)
        matrix[:3, :3] = x, np.cross(z, x), z
        matrix[:3, 3] = -matrix[:3, :3] @ position
        focal = height / 2 / np.tan(np.radians(fov_y) / 2)
        if kwargs.get("projection") == "orthographic":
            focal /= distance
        return cls(matrix, focal, focal, width / 2, height / 2, width, height, **kwargs)

    @classmethod
    def framing(
        cls,
        sphere: tuple[ArrayLike, float],
        azimuth: float = 0.0,
        elevation: float = 0.0,
        up: ArrayLike = (0.0, 1.0, 0.0),
        fov_y: float = 45.0,
        width: int = 512,
        height: int = 512,
        **kwargs: Any,
    ) -> Camera:
        """Make a camera that sees a whole sphere.

        Parameters
        ----------
        sphere : (3,) float and float
            Center, world space, and radius, scene units (`Splats.bounding_sphere`).
        azimuth, elevation : float
            Degrees. Azimuth 0 looks from +z for ``up`` = y and from -y for ``up`` = z. Azimuth turns the eye
            counterclockwise, seen from above; elevation, -90 to 90, lifts the eye toward `up`. At elevation 90
            (-90), the azimuth's side of the sphere is at the image's lower (upper) edge.
        up, fov_y, width, height, **kwargs
            As for `look_at`.

        Raises
        ------
        CameraError
            A number is out of its range; the message names it.
        """
        center, radius, upward = vector("center", sphere[0]), float(sphere[1]) or 1.0, vector("up", up)
        if not 0 < radius < np.inf:
            raise CameraError(f"radius {radius} must be finite and not negative")
        if not np.isfinite(azimuth):
            raise CameraError(f"azimuth {azimuth} must be finite")
        if not -90 <= elevation <= 90:
            raise CameraError(f"elevation {elevation} must be between -90 and 90 degrees")
        _check_size(width, height)
        _check_fov(fov_y)
        if not np.linalg.norm(upward) > 0:
            raise CameraError(f"up {up!r} must be a direction; it has no length")
        upward = upward / np.linalg.norm(upward)
        front = np.array([0.0, -1.0, 0.0]) if abs(upward[2]) > 0.5 else np.array([0.0, 0.0, 1.0])
        front -= upward * (front @ upward)
        front /= np.linalg.norm(front)
        side = np.cross(upward, front)
        a, e = np.radians(azimuth), np.radians(elevation)
        level = np.cos(a) * front + np.sin(a) * side
        outward = np.cos(e) * level + np.sin(e) * upward
        half = np.arctan(np.tan(np.radians(fov_y) / 2) * min(1.0, width / height))
        distance = radius / np.sin(half)
        kwargs.setdefault("near", max(distance - 1.1 * radius, 1e-3 * radius))
        top = upward if np.cos(e) > POLE else -np.sign(e) * level
        return cls.look_at(center + distance * outward, center, top, fov_y, width, height, **kwargs)


def _check_size(width: int, height: int) -> None:
    if not (1 <= width <= MAX_SIZE and 1 <= height <= MAX_SIZE):
        raise CameraError(f"image size {width}x{height} must be between 1x1 and {MAX_SIZE}x{MAX_SIZE}")


def _check_fov(fov_y: float) -> None:
    if not 0 < fov_y < 180:
        raise CameraError(f"fov_y {fov_y} must be between 0 and 180 degrees")


def vector(name: str, value: ArrayLike, error: type[SplatclError] = CameraError) -> NDArray[np.float64]:
    """Convert `value` to a new (3,) float64 array of finite numbers, or raise `error` with `name`."""
    try:
        array = np.array(value, np.float64)
    except (TypeError, ValueError):
        array = np.empty(0)
    if array.shape != (3,) or not np.isfinite(array).all():
        raise error(f"{name} {value!r} must be three finite numbers")
    return array


def rotated(rotation: NDArray[np.float64], vector: NDArray[np.float64]) -> NDArray[np.float64]:
    """Multiply a (3, 3) matrix by a (3,) vector in a fixed order; a BLAS gives other bits on other CPUs."""
    return (rotation[:, 0] * vector[0] + rotation[:, 1] * vector[1]) + rotation[:, 2] * vector[2]
