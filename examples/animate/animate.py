"""Waves run over a scan: one upload, then updates of what moves. Writes one PNG for each frame.

python examples/animate/animate.py reference_images/scans/bunny.pts -o frames
"""

from __future__ import annotations

import argparse
from pathlib import Path
from time import perf_counter

import numpy as np

import splatcl

HEIGHT, WAVES = 0.01, 3.0
"""Height of the waves and their number along the model, both relative to the model's largest side."""


def waved(splats: splatcl.Splats, phase: float) -> dict[str, np.ndarray]:
    """Return center and tangents of splats that a sine wave along y moves along their normals."""
    size = float(np.ptp(splats.bounds, axis=0).max())
    wave, normal = 2 * np.pi * WAVES / size, splats.normal
    angle = wave * splats.center[:, 1:2] - phase
    moved = {"center": splats.center + HEIGHT * size * np.sin(angle) * normal}
    slope = HEIGHT * size * wave * np.cos(angle)  # of the height along y
    for name in ("tangent_u", "tangent_v"):
        tangent = getattr(splats, name)
        moved[name] = tangent + slope * tangent[:, 1:2] * normal
    return {name: values.astype(np.float32) for name, values in moved.items()}


def main(arguments: list[str] | None = None) -> None:
    """Render the frames that the arguments ask for."""
    parser = argparse.ArgumentParser(description="Animate a model with waves.")
    parser.add_argument("input", type=Path, help="file with splats, points or triangles")
    parser.add_argument("-o", "--output", type=Path, default=Path("frames"), help="folder for the PNGs")
    parser.add_argument("--frames", type=int, default=24, help="number of frames of one period")
    parser.add_argument("--size", type=int, default=512, help="width and height, pixels")
    given = parser.parse_args(arguments)
    given.output.mkdir(parents=True, exist_ok=True)

    splats = splatcl.read(given.input)
    size = {"width": given.size, "height": given.size}
    camera = splatcl.Camera.framing(splats.bounding_sphere, azimuth=30, elevation=20, **size)
    settings = splatcl.RenderSettings()
    renderer = splatcl.Renderer()
    uploaded = renderer.upload(splats)
    start = perf_counter()
    for k in range(given.frames):
        uploaded = renderer.update(uploaded, **waved(splats, 2 * np.pi * k / given.frames))
        renderer.render(uploaded, camera, settings).save(given.output / f"{k:03}.png")
    print(f"{given.frames} frames of {len(splats)} splats in {perf_counter() - start:.2f} s: {given.output}")


if __name__ == "__main__":
    main()
