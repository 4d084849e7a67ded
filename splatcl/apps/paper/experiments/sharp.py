"""Clip lines: a cube of a few splats and a solid of several surfaces ([ZRB04] figures 5 and 8)."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splatcl import features
from splatcl.apps.paper.experiment import Claim, Figure, Result, Run, verdict
from splatcl.apps.paper.scenes import rays
from splatcl.scene.camera import Camera
from splatcl.scene.splats import Splats

SIZE = 192
EYE = (1.6, 1.3, 2.1)
FACES = {"prefilter": "none", "epsilon": 1e-3}
CSG_SPACING = 0.06
NEAR_SURFACE = 0.02
"""Largest distance of a pixel's position from the solid's surface, scene units."""


def sharp_features(run: Run) -> Result:
    """Draw a cube of 24 splats, and a box minus a ball, with and without their clip lines."""
    camera = Camera.look_at(EYE, (0, 0, 0), width=run.pixels(SIZE), height=run.pixels(SIZE), fov_y=45)
    cube, solid = features.cube(), features.box((0, 0, 0), (1, 1, 1)) - features.sphere((0.3, 0.3, 0.5), 0.45)
    truth = cube_truth(camera)
    carved = features.csg_splats(solid, CSG_SPACING)
    figures, images, wrong, astray = [], {}, {}, {}
    for name, strip in {"clipped": False, "whole discs": True}.items():
        frame = run.render(_splats(cube, strip), camera, **FACES)
        wrong[name] = 100 * float(np.count_nonzero((frame.color[..., 3] > 0) != truth) / np.count_nonzero(truth))
        figures.append(Figure(f"cube, {name}", "wrong silhouette", wrong[name], "%"))
        images[f"cube, {name}"] = frame.color
        frame = run.render(_splats(carved, strip), camera, prefilter="none")
        astray[name] = 100 * _off_surface(solid, frame["Z"], camera)
        figures.append(Figure(f"box minus ball, {name}", "pixels off the surface", astray[name], "%"))
        images[f"box minus ball, {name}"] = frame.color
    claims = (
        Claim(
            "Clip lines give sharp edges and corners. A cube needs only a few splats.",
            f"With {len(cube)} splats, {wrong['clipped']:.2g}% of the silhouette's pixels are wrong; "
            f"{wrong['whole discs']:.0f}% without clip lines.",
            verdict(wrong["clipped"] < 0.5 and wrong["clipped"] < wrong["whole discs"] / 10),
        ),
        Claim(
            "Clip lines render solids of constructive geometry.",
            f"{astray['clipped']:.2g}% of the pixels are off the surface of a box minus a ball by more than "
            f"{NEAR_SURFACE:g} of its side; {astray['whole discs']:.2g}% without clip lines.",
            verdict(astray["clipped"] < 1 and astray["clipped"] < astray["whole discs"] / 4),
        ),
    )
    title = "[ZRB04] Figures 5, 8: sharp features by clip lines"
    return Result("sharp_features", title, tuple(figures), claims, images)


def _splats(splats: Splats, strip: bool) -> Splats:
    """Return the splats, without their clip lines if `strip`."""
    return replace(splats, clip=None, on_invalid="error") if strip else splats


def cube_truth(camera: Camera) -> NDArray[Any]:
    """Return (H, W) bool: whether a pixel's ray hits the cube of side 1 about the world's origin."""
    origin, direction = rays(camera)
    with np.errstate(divide="ignore"):
        ends = np.stack([(side - origin) / direction for side in (-0.5, 0.5)])
    return ends.min(axis=0).max(axis=-1) <= ends.max(axis=0).min(axis=-1)


def _off_surface(solid: features.Solid, z: NDArray[Any], camera: Camera) -> float:
    """Return the share of the covered pixels whose position at the (H, W) depth `z` is far from the solid's surface.

    A position is near the surface if one step along or against some axis leads inside the solid and another outside.
    """
    covered = np.isfinite(z)
    origin, direction = rays(camera)
    point = origin + z[covered].astype(np.float64)[:, None] * direction[covered]
    steps = NEAR_SURFACE * np.concatenate([np.eye(3), -np.eye(3)])
    inside = np.stack([solid.inside(point + step) for step in steps])
    return float(np.mean(inside.all(axis=0) | ~inside.any(axis=0)))
