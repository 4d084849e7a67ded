"""Shaders over one G-buffer: Phong, shadows and non-photorealistic ([BHZK05] figure 5)."""

from __future__ import annotations

from typing import Any

import numpy as np

from splatcl.apps.paper.experiment import Claim, Figure, Result, Run, verdict
from splatcl.apps.paper.metrics import num_levels
from splatcl.apps.paper.scenes import scan
from splatcl.scene.camera import Camera
from splatcl.scene.lights import Light
from splatcl.scene.splats import Splats

SIZE = 224
TOWARD_LIGHT = (1.0, 0.9, 0.4)
SHADERS: dict[str, dict[str, Any]] = {
    "Phong": {"lights": (Light("directional", TOWARD_LIGHT),)},
    "shadows": {"lights": (Light("directional", TOWARD_LIGHT, shadow="pcf"),)},
    "NPR": {"shader": "npr", "lights": (Light("directional", TOWARD_LIGHT),)},
}
GBUFFER = ("Z", "N", "P", "albedo", "weight", "count", "particleid")
MOST_TONES = 6
"""Maximum number of tones in NPR's picture of one color: four tones, the lines, and one to spare."""
FLOOR_DISCS = 60
"""Discs along a side of the floor below the scan."""


def shaders(run: Run) -> Result:
    """Shade the same splats by three shaders and compare their G-buffers."""
    splats, notes = scan()
    scene = standing(splats)
    side = run.pixels(SIZE)
    camera = Camera.framing(splats.bounding_sphere, azimuth=20, elevation=25, width=side, height=side)
    frames = {name: run.render(scene, camera, **given) for name, given in SHADERS.items()}
    plain = frames["Phong"]
    covered = plain.color[..., 3] > 0
    tones = {name: num_levels(frame.color[covered][:, 0].round(3)) for name, frame in frames.items()}
    darker = 100 * float(np.mean(frames["shadows"].color[covered][:, 1] < plain.color[covered][:, 1] - 0.01))
    figures = [Figure(name, "different tones", number) for name, number in tones.items()]
    figures.append(Figure("shadows", "pixels in shadow", darker, "%"))
    same = all(np.array_equal(frame[aov], plain[aov]) for frame in frames.values() for aov in GBUFFER)
    claims = (
        Claim(
            "Deferred shading separates shading from rasterization, so custom shaders are simple.",
            f"Depth, normals, positions, albedo, weights, counts and ids {'have' if same else 'do not have'} "
            f"the same bits under {len(SHADERS)} shaders.",
            verdict(same),
        ),
        Claim(
            "A shader may use all attributes of a pixel, for non-photorealistic images as well.",
            f"NPR draws {tones['NPR']} tones where Phong draws {tones['Phong']}.",
            verdict(1 < tones["NPR"] <= MOST_TONES < tones["Phong"]),
        ),
        Claim("Shadow maps work on splats.", f"{darker:.0f}% of the pixels lie in shadow.", verdict(1 < darker < 50)),
    )
    title = "[BHZK05] Figure 5: shaders"
    return Result("shaders", title, tuple(figures), claims, {n: f.color for n, f in frames.items()}, notes)


def standing(splats: Splats) -> Splats:
    """Return the splats in their first color on a square floor twice as wide as they are."""
    low, high = splats.bounds
    middle, half = (low + high) / 2, (high - low)[::2].max()
    along = half * (2 * (np.arange(FLOOR_DISCS) + 0.5) / FLOOR_DISCS - 1)
    x, z = (axis.ravel() for axis in np.meshgrid(along, along))
    center = np.stack([middle[0] + x, np.full(len(x), low[1]), middle[2] + z], axis=1).astype(splats.center.dtype)
    u, v = np.zeros_like(center), np.zeros_like(center)
    u[:, 2] = v[:, 0] = 1.6 * half / FLOOR_DISCS
    parts = ((splats.center, center), (splats.tangent_u, u), (splats.tangent_v, v))
    center, u, v = (np.concatenate(part) for part in parts)
    return Splats(center, u, v, np.tile(splats.color[:1], (len(center), 1)), splats.oriented)
