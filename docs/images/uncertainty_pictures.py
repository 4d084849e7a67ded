"""Render the picture of docs/trust/uncertainty.md: ``python docs/images/uncertainty_pictures.py``."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from splatcl import Camera, read, render
from splatcl.io.png import write_png

FOLDER = Path(__file__).parent
BUNNY = FOLDER.parents[1] / "reference_images" / "scans" / "bunny.pts"
MOST_UNITS = 128
"""Margin that is white, in rounding units."""
LEAST_WIDTH, MOST_WIDTH = 1e-4, 1.0
"""Widths of the normal's envelope that are black and white, on a logarithmic scale."""


def main() -> None:
    """Write color, margin and width of the normal's envelope, side by side."""
    bunny = read(BUNNY)
    frame = render(bunny, Camera.framing(bunny.bounding_sphere, azimuth=20, elevation=10, width=260, height=250))
    frame.add_envelope()
    margin = (frame["margin"] / MOST_UNITS) ** 2  # seen as sRGB, about linear
    width = np.maximum((frame["N.hi"] - frame["N.lo"]).max(axis=2), LEAST_WIDTH)
    width = (np.log(width / LEAST_WIDTH) / np.log(MOST_WIDTH / LEAST_WIDTH)) ** 2
    gray = (np.repeat(image.clip(0, 1)[..., None], 4, axis=2) for image in (margin, width))
    pictures = [frame.color, *gray]
    for picture in pictures[1:]:
        picture[..., 3] = 1
    write_png(FOLDER / "uncertainty.png", np.concatenate(pictures, axis=1))


if __name__ == "__main__":
    main()
