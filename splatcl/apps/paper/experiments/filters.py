"""Combined kernels: the minimum of two radii against a convolution ([BHZK05] figure 4)."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_erosion

from splatcl.apps.paper.experiment import Claim, Figure, Result, Run, verdict
from splatcl.apps.paper.metrics import area, second_moments
from splatcl.scene.camera import Camera
from splatcl.scene.splats import Splats

Array = NDArray[Any]
SIZE = 192
RATIOS = (0.25, 1.0, 4.0)
"""Radii of the splat, in units of the pre-filter's radius."""
ASPECT = 1.5
REACH = 0.45
"""Half width of the larger kernel, in units of the image's side."""
CUTOFF = 2.0
LEVELS = (0.25, 0.5, 0.75, 1.0)
MEANING = "Both low-pass filters are the same Gaussian. Contours are at r = 0.25, 0.5, 0.75 and 1."
MIN_COLOR, EWA_COLOR = (0.9, 0.35, 0.0), (0.0, 0.2, 0.8)
DISTANCE = 1e3
"""Distance of the splat. All rays are nearly parallel."""


def kernels(run: Run) -> Result:
    """Draw one facing ellipse with a pre-filter of many pixels, so that an image is a kernel."""
    size = run.pixels(SIZE) | 1
    figures, images, ratios = [], {}, {}
    for ratio in RATIOS:
        least, most = (kernel(run, size, ratio, name) for name in ("min", "ewa"))
        ratios[ratio] = areas = area(most) / area(least)
        spread = np.trace(second_moments(most)) / np.trace(second_moments(least))
        name = f"splat {ratio:g} x filter"
        figures.append(Figure(name, "area EWA / min", areas))
        figures.append(Figure(name, "in closed form", expected(ratio)))
        figures.append(Figure(name, "second moment EWA / min", spread))
        images[name] = contours(least, most)
    small, even, large = (ratios[ratio] for ratio in RATIOS)
    claims = (
        Claim(
            "The minimum of both radii is close to EWA's kernel where the splat is much larger or much smaller than a "
            "pixel. It differs most where their sizes are alike.",
            f"EWA's footprint has {small:.2f}, {even:.2f} and {large:.2f} times the area for splats of a quarter, one "
            "and four times the filter's radius.",
            verdict(even > max(small, large) and max(small, large) < 1.25),
        ),
    )
    title = "[BHZK05] Figure 4: contours of the combined kernels, min (orange) and EWA (blue)"
    return Result("kernels", title, tuple(figures), claims, images, (MEANING,))


def kernel(run: Run, size: int, ratio: float, prefilter: Literal["min", "ewa"]) -> Array:
    """Return the (H, W) weights of a splat centered in the image, under a low-pass filter of the same width each."""
    radius = REACH * size / np.hypot(ASPECT * ratio, 1)
    given = {
        "min": {"prefilter_radius": radius},
        "ewa": {"footprint": "conic", "prefilter": "ewa", "prefilter_radius": radius / CUTOFF},
    }
    short = ratio * radius
    u, v, center = np.diag([ASPECT * short, short, DISTANCE])[:, None]
    splat = Splats(center, u, v)
    camera = Camera(np.eye(4), DISTANCE, DISTANCE, size / 2, size / 2, size, size)
    return run.render(splat, camera, shader="albedo", cutoff=CUTOFF, **given[prefilter])["weight"]


def expected(ratio: float) -> float:
    """Return the area of EWA's footprint divided by that of the min filter's, in closed form, for filter radius 1.

    EWA's footprint is the ellipse whose squared axes are sums. The min filter's is the union of an ellipse and the
    unit disc.
    """
    a, b = ASPECT * ratio, ratio
    most = np.pi * np.sqrt((a * a + 1) * (b * b + 1))
    if a <= 1:
        return float(most / np.pi)
    if b >= 1:
        return float(most / (np.pi * a * b))
    x = a * np.sqrt((1 - b * b) / (a * a - b * b))  # where the curves cross
    disc = np.pi - 2 * (np.arccos(x) - x * np.sqrt(1 - x * x))
    return float(most / (disc + 2 * a * b * (np.arccos(x / a) - x / a * np.sqrt(1 - (x / a) ** 2))))


def contours(least: Array, most: Array) -> Array:
    """Return an (H, W, 3) picture of the contours of two kernels at the radii LEVELS."""
    picture = np.ones((*least.shape, 3))
    for weight, color in ((most, EWA_COLOR), (least, MIN_COLOR)):
        # A weight of 0 means that the fragment is outside, with r above 1.
        with np.errstate(divide="ignore"):
            radius = np.sqrt(-2 * np.log(weight / weight.max())) / CUTOFF
        for level in LEVELS:
            inside = radius <= level * (1 + 1e-3)
            picture[inside & ~binary_erosion(inside)] = color
    return picture
