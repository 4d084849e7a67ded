"""The pictures of docs/methods.md: python docs/method_pictures.py (docs/method_NAME.png, and the sheet of all)."""

from __future__ import annotations

from pathlib import Path

import imageio.v3 as iio
import numpy as np

import splatcl
from splatcl import Camera, Light, RenderSettings
from splatcl.io.png import encode_png

DOCS = Path(__file__).parent
SCAN = DOCS.parent / "reference_images" / "scans" / "bunny.pts"
METHODS = ("botsch05", "zwicker04", "zwicker01", "botsch04", "botsch03")
LIGHT = Light("directional", (-0.4, 0.7, 1.0))


def main() -> None:
    """Render 627 large splats, decimated from the bunny, by each method; side by side in the order of METHODS."""
    scan = splatcl.read(SCAN)
    splats = splatcl.decimate(scan, 0.001, fields=True)
    camera = Camera.framing(scan.bounding_sphere, azimuth=20, elevation=10, width=200, height=190)
    images = []
    for method in METHODS:
        settings = RenderSettings(method=method, facing="flip", lights=(LIGHT,))
        frame = splatcl.render(splats, camera, settings)
        images.append(iio.imread(encode_png(frame.color)))
    iio.imwrite(DOCS / "methods.png", np.concatenate(images, axis=1))
    print(f"{len(splats)} splats: {', '.join(METHODS)}")


if __name__ == "__main__":
    main()
