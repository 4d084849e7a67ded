"""The camera's options: a camera file, or a framing of the whole scan."""

from __future__ import annotations

import re
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from cyclopts import Parameter
from numpy.typing import ArrayLike, NDArray

from splatcl.cli.options.groups import CAMERA
from splatcl.errors import CameraError
from splatcl.scene.camera import Camera, Projection
from splatcl.scene.splats import Splats

Axis = Literal["x", "y", "z", "-x", "-y", "-z"]
DEFAULT_SIZE = "512x512"
CLEARLY = 0.25
"""Cosine between view direction and mean normal above which an oriented scan shows its back."""


@dataclass
class View:
    """A camera file, or a framing of the whole scan."""

    camera: Annotated[
        Path | None,
        Parameter(help="Camera file (docs/guide/cameras.md). It replaces the other options of this group."),
    ] = None
    size: Annotated[
        str | None, Parameter(metavar="WIDTHxHEIGHT", help=f"Image size, pixels [default: {DEFAULT_SIZE}].")
    ] = None
    azimuth: Annotated[
        float | None,
        Parameter(
            help="Angle around the scan, degrees, counterclockwise from above "
            "[default: 0, or 180 where the normals clearly point there]."
        ),
    ] = None
    elevation: Annotated[float | None, Parameter(help="Angle above the scan, degrees, -90 to 90 [default: 0].")] = None
    fov: Annotated[float | None, Parameter(help="Vertical angle of view, degrees [default: 45].")] = None
    up: Annotated[
        Axis | None,
        Parameter(
            allow_leading_hyphen=True,
            help="World axis that points up in the image [default: the usual one for files of this kind].",
        ),
    ] = None
    projection: Annotated[
        Projection | None,
        Parameter(help="Both projections show the center of the scan at the same scale [default: perspective]."),
    ] = None

    def file_camera(self) -> Camera | None:
        """Return the camera of the file; without a file, check the other options and return None."""
        from splatcl.io.cameras import read_camera

        if self.camera is None:
            self.framing(((0.0, 0.0, 0.0), 1.0), "y")
            return None
        for field in fields(self):
            if field.name != "camera" and getattr(self, field.name) is not None:
                raise CameraError(
                    f"--camera and --{field.name} cannot be combined: the camera file sets the view; "
                    f"remove --{field.name}"
                )
        return read_camera(self.camera)

    def framing(self, sphere: tuple[ArrayLike, float], up: str, azimuth: float = 0.0) -> Camera:
        """Return a camera that sees all of a bounding sphere; `up` and `azimuth` are the defaults of the options."""
        width, height = self.image_size()
        return Camera.framing(
            sphere,
            azimuth if self.azimuth is None else self.azimuth,
            self.elevation or 0.0,
            axis_vector(self.up or up),
            45.0 if self.fov is None else self.fov,
            width,
            height,
            projection=self.projection or "perspective",
        )

    def facing(self, splats: Splats, up: str) -> tuple[Camera, bool]:
        """Return a camera that sees all splats, and whether it went to azimuth 180, where their normals point."""
        sphere = splats.bounding_sphere
        camera = self.framing(sphere, up)
        if self.azimuth is None and splats.oriented:
            other, mean = self.framing(sphere, up, 180.0), mean_normal(splats)
            if mean @ camera.eye_from_world[2, :3] > CLEARLY and mean @ other.eye_from_world[2, :3] < 0:
                return other, True
        return camera, False

    def image_size(self) -> tuple[int, int]:
        """Return width and height, pixels."""
        match = re.fullmatch(r"([1-9]\d{0,8})x([1-9]\d{0,8})", self.size or DEFAULT_SIZE)
        if not match:
            raise CameraError(f"--size {self.size!r} must be WIDTHxHEIGHT, such as 800x600")
        return int(match[1]), int(match[2])


ViewOptions = Annotated[View | None, Parameter(name="*", group=CAMERA)]


def mean_normal(splats: Splats) -> NDArray[np.float64]:
    """Return the (3,) mean of the normals by area, world space: near 0 for a closed surface, unit for a plane."""
    normals = np.cross(splats.tangent_u.astype(np.float64), splats.tangent_v.astype(np.float64))
    return normals.sum(axis=0) / max(float(np.linalg.norm(normals, axis=1).sum()), np.finfo(float).tiny)


def axis_vector(axis: str) -> tuple[float, float, float]:
    """Return the unit vector of an axis such as "x" or "-z"."""
    sign = -1.0 if axis.startswith("-") else 1.0
    x, y, z = (sign * (axis[-1] == letter) for letter in "xyz")
    return x, y, z
