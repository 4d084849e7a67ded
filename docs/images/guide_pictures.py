"""Render cameras.png, supersampling.png and features.png of docs/guide: ``python docs/images/guide_pictures.py``."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from splatcl import Camera, Light, RenderSettings, Splats, read, render
from splatcl.features import box, csg_splats, cylinder, sphere
from splatcl.io.png import write_png

FOLDER = Path(__file__).parent
SCAN = FOLDER.parents[1] / "reference_images" / "scans" / "bunny.pts"
SUN = RenderSettings(lights=(Light("directional", (-0.4, 0.7, 1.0)),))
ENLARGED = 5


def cameras(bunny: Splats) -> NDArray[np.float32]:
    """Return the bunny from four sides, beside each other."""
    views = [
        Camera.framing(bunny.bounding_sphere, azimuth, elevation=20, width=200, height=170)
        for azimuth in (0, 90, 180, 270)
    ]
    return np.concatenate([render(bunny, view).color for view in views], axis=1)


def supersampling(bunny: Splats) -> NDArray[np.float32]:
    """Return the bunny's ear with 1, 2x2 and 8x8 samples a pixel, enlarged."""
    whole = Camera.framing(bunny.bounding_sphere, azimuth=0, elevation=10, width=150, height=150)
    ear = replace(whole, cx=whole.cx - 30, cy=whole.cy - 18, width=48, height=44)
    pictures = [render(bunny, ear, RenderSettings(supersampling=n)).color for n in (1, 2, 8)]
    strip = np.concatenate(pictures, axis=1).repeat(ENLARGED, axis=0).repeat(ENLARGED, axis=1)
    on_white = strip[..., :3] + (1 - strip[..., 3:])  # RGB is associated
    return np.concatenate([on_white, np.ones_like(strip[..., 3:])], axis=2)


def features() -> NDArray[np.float32]:
    """Return a box less a ball and a cylinder, without and with clip lines."""
    solid = (
        box((0, 0, 0), (1, 1, 1))
        - sphere((0.5, 0.5, 0.5), 0.45, (0.8, 0.2, 0.2))
        - cylinder((0, -1, -0.1), (0, 1, -0.1), 0.25)
    )
    splats = csg_splats(solid, spacing=0.15)
    camera = Camera.framing(splats.bounding_sphere, azimuth=35, elevation=25, width=320, height=280)
    whole = Splats(splats.center, splats.tangent_u, splats.tangent_v, splats.color)
    pictures = [render(each, camera, replace(SUN, epsilon=0.01)).color for each in (whole, splats)]
    return np.concatenate(pictures, axis=1)


def main() -> None:
    """Write the pictures."""
    bunny = read(SCAN)
    write_png(FOLDER / "cameras.png", cameras(bunny))
    write_png(FOLDER / "supersampling.png", supersampling(bunny))
    write_png(FOLDER / "features.png", features())


if __name__ == "__main__":
    main()
