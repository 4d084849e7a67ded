"""Render the pictures of docs/guide/lights.md: ``python docs/images/light_pictures.py``."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from splatcl import Camera, Light, Material, RenderSettings, Splats, environment_lights, read, render

FOLDER = Path(__file__).parent
BUNNY = FOLDER.parents[1] / "reference_images" / "scans" / "bunny.pts"
SUN = (1.0, 1.3, 0.4)


def scene() -> tuple[Splats, Camera]:
    """Return the bunny on a ground of square rows of discs, and a camera before it."""
    bunny = read(BUNNY)
    (center, radius), floor, num = bunny.bounding_sphere, bunny.bounds[0, 1], 90
    x, z = (grid.ravel() for grid in np.meshgrid(*[np.linspace(-2.2 * radius, 2.2 * radius, num)] * 2))
    ground = np.stack([center[0] + x, np.full(x.size, floor), center[2] + z], axis=1)
    step = np.full((x.size, 1), 4.4 * radius / (num - 1))
    parts = {
        "center": (bunny.center, ground),
        "tangent_u": (bunny.tangent_u, step * [0, 0, 1]),
        "tangent_v": (bunny.tangent_v, step * [1, 0, 0]),
        "color": (np.full((len(bunny), 3), (0.8, 0.55, 0.35)), np.full(ground.shape, 0.6)),
    }
    splats = Splats(**{name: np.vstack(arrays) for name, arrays in parts.items()}, oriented=False)
    eye = center + np.array([0.65, 1.4, 3.0]) * radius
    target = center - np.array([0.2, 0.3, 0]) * radius
    return splats, Camera.look_at(eye, target, fov_y=40, width=320, height=240, near=0.1 * radius)


def sky() -> np.ndarray:
    """Return (64, 128, 3) radiance: a blue sky, brown ground and a low sun at the right."""
    height = np.linspace(1, -1, 64)[:, None, None]
    image = np.where(height > 0, np.array([0.12, 0.22, 0.45]) * (1 - 0.6 * height), (0.06, 0.05, 0.04))
    image = np.tile(image, (1, 128, 1))
    image[12:20, 24:32] = (26.0, 21.0, 15.0)
    return image


def main() -> None:
    """Write the pictures."""
    splats, camera = scene()
    place = tuple(float(x) for x in splats.bounding_sphere[0] + np.array([0.35, 0.7, 0.3]))
    aim = tuple(float(x) for x in splats.bounding_sphere[0] - place - np.array([0, 0.08, 0]))
    settings = {
        "spot": RenderSettings(lights=(Light("spot", place, direction=aim, inner=6, outer=10, shadow="pcf"),)),
        "nearest": RenderSettings(lights=(Light("directional", SUN, shadow="nearest", map_size=160),)),
        "pcf": RenderSettings(lights=(Light("directional", SUN, shadow="pcf", map_size=160),)),
        "environment": RenderSettings(
            lights=environment_lights(sky()), shader="lightmap", material=Material(0.0, 1.0, 0.1, 32.0)
        ),
    }
    for name, one in settings.items():
        render(splats, camera, one).save(FOLDER / f"light_{name}.png")


if __name__ == "__main__":
    main()
