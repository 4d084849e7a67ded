"""Where a command looks from: the camera's options, and the framing of a scan."""

from __future__ import annotations

import re
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from cyclopts import Parameter
from numpy.typing import ArrayLike, NDArray

from splatcl.errors import CameraError
from splatcl.scene.camera import Camera, Projection
from splatcl.scene.splats import OnInvalid, Splats
from splatcl.util.progress import stage

Axis = Literal["x", "y", "z", "-x", "-y", "-z"]
DEFAULT_SIZE = "512x512"
CLEARLY = 0.25
"""Cosine of the view's direction with the mean normal above which the scan's one side points away."""


@dataclass
class View:
    """Where to look from: a camera file, or a framing of the whole scan.

    Parameters
    ----------
    camera : path
        Camera file (docs/guide/cameras.md); excludes the other options of this group.
    size : str
        Image size, WIDTHxHEIGHT pixels [default: 512x512].
    azimuth : float
        Degrees around the scan, counter-clockwise seen from above [default: 0, or 180 where the scan's normals
        clearly point there].
    elevation : float
        Degrees above the scan, -90 to 90 [default: 0].
    fov : float
        Vertical angle of view, degrees [default: 45].
    up : str
        World axis that points up in the image [default: as files of the scan's kind have it].
    projection : str
        Perspective, or orthographic with what is seen at the scan's middle [default: perspective].
    """

    camera: Path | None = None
    size: str | None = None
    azimuth: float | None = None
    elevation: float | None = None
    fov: float | None = None
    up: Annotated[Axis | None, Parameter(allow_leading_hyphen=True)] = None
    projection: Projection | None = None

    def file_camera(self) -> Camera | None:
        """Return the camera of the file; where none is given check the other options and return None."""
        from splatcl.io.cameras import read_camera

        if self.camera is None:
            self.framing(((0.0, 0.0, 0.0), 1.0), "y")
            return None
        for name in ("size", "azimuth", "elevation", "fov", "up", "projection"):
            if getattr(self, name) is not None:
                raise CameraError(f"--camera and --{name} exclude each other: the camera file says it all")
        return read_camera(self.camera)

    def framing(self, sphere: tuple[ArrayLike, float], up: str, azimuth: float = 0.0) -> Camera:
        """Return a camera that sees all of a bounding sphere; `up` and `azimuth` are for want of options."""
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
        """Return a camera that sees all splats, and whether it is on the other side: where their normals point."""
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
            raise CameraError(f"--size {self.size!r} is not WIDTHxHEIGHT, such as 800x600")
        return int(match[1]), int(match[2])


def read_splats(scan: Path, on_invalid: OnInvalid, say: Callable[[str], None] = print) -> Splats:
    """Return the splats of a file; `say` what was done."""
    from splatcl.io.read import read

    start = time.perf_counter()
    with stage(f"Reading {scan.name}"):
        splats = read(scan, on_invalid)
    say(f"read {scan}: {len(splats)} splats in {time.perf_counter() - start:.2f} s")
    for note in splats.notes:
        say(f"note: {note}")
    return splats


def read_scan(
    scan: Path, on_invalid: OnInvalid, view: View, camera: Camera | None, say: Callable[[str], None] = print
) -> tuple[Splats, Camera]:
    """Return the splats of a file, and `camera` or else one that frames them; `say` what was done."""
    from splatcl.io.read import up_axis

    splats = read_splats(scan, on_invalid, say)
    if camera:
        return splats, camera
    framed = splats.without_outliers()
    if len(framed) < len(splats):
        say(f"note: framed without {len(splats) - len(framed)} strays, which are rendered all the same")
    camera, turned = view.facing(framed, up_axis(scan))
    if turned:
        say("note: looked from azimuth 180, where the normals point; --azimuth 0 shows the other side")
    return splats, camera


def mean_normal(splats: Splats) -> NDArray[np.float64]:
    """Return the (3,) mean of the normals by area, world space: near 0 for a closed surface, 1 long for a plane."""
    normals = np.cross(splats.tangent_u.astype(np.float64), splats.tangent_v.astype(np.float64))
    return normals.sum(axis=0) / max(float(np.linalg.norm(normals, axis=1).sum()), np.finfo(float).tiny)


def axis_vector(axis: str) -> tuple[float, float, float]:
    """Return the unit vector of "x", "-z" ..."""
    sign = -1.0 if axis.startswith("-") else 1.0
    x, y, z = (sign * (axis[-1] == letter) for letter in "xyz")
    return x, y, z
