"""The picture of docs/guide/methods.md, docs/images/methods.png: python docs/images/method_pictures.py."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import splatcl
from splatcl import Camera, Light, RenderSettings
from splatcl.io.png import write_png
from splatcl.scene.settings import METHODS

FOLDER = Path(__file__).parent
SCAN = FOLDER.parents[1] / "reference_images" / "scans" / "bunny.pts"
LIGHT = Light("directional", (-0.4, 0.7, 1.0))


def main() -> None:
    """Render 627 large splats, decimated from the bunny, by each method; side by side in the order of METHODS."""
    scan = splatcl.read(SCAN)
    splats = splatcl.decimate(scan, 0.001, fields=True)
    camera = Camera.framing(scan.bounding_sphere, azimuth=20, elevation=10, width=200, height=190)
    colors = []
    for method in METHODS:
        settings = RenderSettings(method=method, facing="flip", lights=(LIGHT,))
        colors.append(splatcl.render(splats, camera, settings).color)
    write_png(FOLDER / "methods.png", np.concatenate(colors, axis=1))
    print(f"{len(splats)} splats: {', '.join(METHODS)}")


if __name__ == "__main__":
    main()
