"""Affine, conic and ray-cast outlines at extreme perspective ([ZRB04] figures 2, 3 and 7)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from splatcl.apps.paper.experiment import Claim, Figure, Result, Run, verdict
from splatcl.apps.paper.scenes import low_camera, on_floor, rays, touching_floor
from splatcl.scene.camera import Camera
from splatcl.scene.splats import Splats

WIDTH, HEIGHT = 256, 192
TILT, RADIUS = 70.0, 0.7
"""Tilt of the single disc, degrees, and its radius in scene units at a distance of 1."""
OUTLINES: dict[str, dict[str, Any]] = {
    "affine": {"method": "zwicker01"},
    "conic": {"footprint": "conic"},
    "ray cast": {"method": "botsch05"},
}
MEANING = (
    "The error of one tilted disc is its wrong pixels divided by its area. A disc through the eye plane has no conic "
    "that is an ellipse, and is left out."
)
BARE = {"prefilter": "none", "shader": "albedo"}


def holes(run: Run) -> Result:
    """Draw a floor of touching discs close to the eye, and a single tilted disc, with each outline."""
    floor, camera = touching_floor(), low_camera(run.pixels(WIDTH), run.pixels(HEIGHT))
    inside = on_floor(camera)
    one, lens = tilted_disc(), Camera.look_at((0, 0, 0), (0, 0, -1), width=camera.width, height=camera.width, fov_y=100)
    exact = disc_truth(lens)
    low = low_camera(camera.width, camera.height, down=20)
    figures, images, discs, open_share, through, shape_error = [], {}, {}, {}, {}, {}
    for name, given in OUTLINES.items():
        color = run.render(floor, camera, **BARE, **given).color
        open_share[name] = hole_share(color, inside)
        images[name] = color
        disc = run.render(one, lens, **BARE, **given).color[..., 3] > 0
        shape_error[name] = 100 * float(np.count_nonzero(disc != exact) / np.count_nonzero(exact))
        figures.append(Figure(name, "uncovered floor", open_share[name], "%"))
        through[name] = hole_share(run.render(floor, low, **BARE, **given).color, on_floor(low))
        figures.append(Figure(name, "with discs through the eye plane", through[name], "%"))
        figures.append(Figure(name, "wrong pixels of one disc", shape_error[name], "%"))
        discs[f"disc, {name}"] = np.stack([exact, disc, disc], axis=-1).astype(float)
    claims = (
        Claim(
            "The affine approximation of the projection leaves holes between splats seen from nearby.",
            f"{open_share['affine']:.2f}% of the floor's pixels are not covered although its discs leave no gap.",
            verdict(open_share["affine"] > 0),
        ),
        Claim(
            "Splats that are projected exactly, as conics, close the surface.",
            f"{open_share['conic']:.2f}% uncovered; {shape_error['conic']:.2g}% of a tilted disc's pixels are wrong, "
            f"against {shape_error['affine']:.2g}%.",
            verdict(not open_share["conic"] and shape_error["conic"] < shape_error["affine"] / 10),
        ),
        Claim(
            "Conics leave no holes even under extreme perspective.",
            f"{through['conic']:.1f}% of the floor's pixels are not covered where discs pass through the eye plane.",
            verdict(not through["conic"]),
        ),
        Claim(
            "Ray casting per pixel is exact as well [BHZK05].",
            f"{open_share['ray cast']:.2f}% uncovered, {shape_error['ray cast']:.2g}% wrong.",
            verdict(not open_share["ray cast"] and shape_error["ray cast"] < shape_error["affine"] / 10),
        ),
    )
    title = "[ZRB04] Figures 2, 3, 7: outlines of splats at extreme perspective (discs: red missing, cyan too much)"
    return Result("holes", title, tuple(figures), claims, images | discs, (MEANING,))


def hole_share(color: NDArray[Any], inside: NDArray[Any]) -> float:
    """Return the uncovered share of the pixels `inside`, percent."""
    return 100 * float(np.mean(color[inside][:, 3] == 0))


def tilted_disc() -> Splats:
    """Return one disc in front of the world's origin, whose near end is near the eye."""
    tilt = np.radians(TILT)
    along = RADIUS * np.array([[0, np.cos(tilt), np.sin(tilt)]])
    return Splats(np.array([[0, 0, -1.0]]), np.array([[RADIUS, 0, 0]]), along)


def disc_truth(camera: Camera) -> NDArray[Any]:
    """Return (H, W) bool: whether a pixel's ray hits the tilted disc."""
    disc = tilted_disc()
    origin, direction = rays(camera)
    u, v, center = (np.asarray(a[0], np.float64) for a in (disc.tangent_u, disc.tangent_v, disc.center))
    normal = np.cross(u, v)
    distance = normal @ (center - origin) / (direction @ normal)
    offset = origin + direction * distance[..., None] - center
    return (distance > 0) & (np.square(offset @ u) + np.square(offset @ v) <= RADIUS**4)
