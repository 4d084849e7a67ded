"""A checkerboard at a grazing angle under every filter ([BHZK05] figure 3, [ZRB04] figure 6)."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splatcl.apps.paper import metrics
from splatcl.apps.paper.experiment import Claim, Figure, Result, Run, verdict
from splatcl.apps.paper.scenes import DARK, LIGHT, checkerboard, checkerboard_camera, checkerboard_truth, undersampled
from splatcl.scene.camera import Camera

WIDTH, HEIGHT = 256, 192
RAYS = 16
"""Rays along a pixel's side in the truth, and samples in the supersampled truth."""
SHEET = {"shader": "albedo", "epsilon": 1e3}
"""The scene has one surface, so no fragment lies behind another surface."""
MEANING = (
    "Aliasing is the root mean square difference from gray, in percent of white, where a pixel is longer than two "
    f"squares. The truth is the mean of {RAYS}x{RAYS} rays a pixel through the squares themselves."
)
SAMPLES = f"`PSNR by {RAYS}x{RAYS}` compares with as many samples of the splats, without a filter."
LOW_PASS = (
    "EWA's low-pass filter has a standard deviation of 1 pixel. EWA/2 has half of that, as the min filter's Gaussian."
)
NARROW = {"footprint": "conic", "prefilter": "ewa", "prefilter_radius": 0.5}
"""EWA whose low-pass is the Gaussian of the min filter: its standard deviation is 1 pixel / cutoff."""
FILTERS: dict[str, dict[str, Any]] = {
    "none": {"prefilter": "none"},
    "2x2": {"prefilter": "none", "supersampling": 2},
    "3x3": {"prefilter": "none", "supersampling": 3},
    "min": {},
    "EWA": {"footprint": "conic", "prefilter": "ewa"},
    "EWA/2": NARROW,
}


@cache
def truth(width: int, height: int) -> NDArray[Any]:
    """Return the (H, W, 3) checkerboard's image from rays alone, read-only."""
    image = checkerboard_truth(checkerboard_camera(width, height), RAYS)
    image.setflags(write=False)
    return image


def aliasing(image: NDArray[Any], camera: Camera) -> float:
    """Return the root mean square difference from gray, percent of white, where pixels are longer than two squares."""
    gray = (np.array(LIGHT) + DARK) / 2
    return 100 * float(np.sqrt(np.mean(np.square(image[undersampled(camera)] - gray))))


def checkerboards(run: Run) -> Result:
    """Compare every filter with rays through the checkerboard itself and with 16 x 16 samples of the splats."""
    splats, camera = checkerboard(), checkerboard_camera(run.pixels(WIDTH), run.pixels(HEIGHT))
    exact = truth(camera.width, camera.height)
    images = {name: run.render(splats, camera, **SHEET, **given).color[..., :3] for name, given in FILTERS.items()}
    samples = run.render(splats, camera, **SHEET, prefilter="none", supersampling=RAYS).color[..., :3]
    figures, measured = [], {}
    for name, image in images.items():
        measured[name] = one = {
            "PSNR": (metrics.psnr(image, exact), "dB"),
            "SSIM": (metrics.ssim(image, exact), ""),
            "FLIP": (metrics.flip(image, exact), ""),
            f"PSNR by {RAYS}x{RAYS}": (metrics.psnr(image, samples), "dB"),
            "aliasing": (aliasing(image, camera), "%"),
        }
        figures += [Figure(name, key, value, unit) for key, (value, unit) in one.items() if value is not None]
    quality, error = ({name: one[key][0] for name, one in measured.items()} for key in ("PSNR", "aliasing"))
    figures.append(Figure("truth", "aliasing", aliasing(exact, camera), "%"))
    notes: tuple[str, ...] = (MEANING, SAMPLES, LOW_PASS)
    notes += () if measured["none"]["FLIP"][0] is not None else (metrics.NO_FLIP,)
    title = "[BHZK05] Figure 3: a checkerboard at a grazing angle"
    return Result("checkerboards", title, tuple(figures), _claims(quality, error), {"truth": exact} | images, notes)


def _claims(quality: dict[str, Any], error: dict[str, Any]) -> tuple[Claim, ...]:
    """Return the claims of figure 3, from each filter's PSNR in dB and aliasing in percent.

    The min filter is comparable to EWA of the same width within 1 dB and a factor of 2 in aliasing. A part of the claim
    holds if aliasing is at most half of that without a filter.
    """
    close = abs(quality["min"] - quality["EWA/2"]) < 1
    return (
        Claim(
            "Object-space filters alone alias where the surface is minified.",
            "Toward the horizon pixels are longer than two squares and should be gray: "
            f"aliasing is {error['none']:.1f}% of white, with EWA {error['EWA']:.1f}%.",
            verdict(error["none"] > 2 * error["EWA"]),
        ),
        Claim(
            "Supersampling by 2x2 or 3x3 reduces aliasing but does not remove it.",
            f"Aliasing of {error['2x2']:.1f}% and {error['3x3']:.1f}% remains.",
            verdict(error["EWA"] < error["3x3"] < error["2x2"] < error["none"]),
        ),
        Claim(
            "The min filter's quality is comparable to EWA's.",
            f"PSNR is {quality['min']:.1f} dB with min, {quality['EWA/2']:.1f} dB with EWA of the same width, "
            f"{quality['none']:.1f} dB without a filter. EWA's own wider low-pass filter blurs more: "
            f"{quality['EWA']:.1f} dB. Aliasing is {error['min']:.1f}%, {error['EWA/2']:.1f}% and "
            f"{error['none']:.1f}%.",
            verdict(close and error["min"] < 2 * error["EWA/2"], part=close and error["min"] < error["none"] / 2),
        ),
        Claim(
            "The min filter removes the aliasing that supersampling by 3x3 leaves.",
            f"Aliasing is {error['min']:.1f}% with min, {error['3x3']:.1f}% with 3x3 samples.",
            verdict(error["min"] < error["3x3"]),
        ),
        Claim(
            "EWA filters best where the view minifies.",
            f"Its aliasing, {error['EWA']:.1f}%, is the least of all filters.",
            verdict(error["EWA"] == min(error.values())),
        ),
    )


def screen_filter(run: Run) -> Result:
    """Draw the checkerboard by conics, with and without the low-pass."""
    splats, camera = checkerboard(), checkerboard_camera(run.pixels(WIDTH), run.pixels(HEIGHT))
    given = {"with": {"prefilter": "ewa"}, "without": {"prefilter": "none"}}
    images = {
        name: run.render(splats, camera, **SHEET, footprint="conic", **one).color[..., :3]
        for name, one in given.items()
    }
    error = {name: aliasing(image, camera) for name, image in images.items()}
    claims = (
        Claim(
            "The screen-space filter removes aliasing artifacts.",
            f"Aliasing is {error['with']:.1f}% of white with it, {error['without']:.1f}% without.",
            verdict(error["with"] < error["without"] / 4),
        ),
    )
    figures = tuple(Figure(name, "aliasing", value, "%") for name, value in error.items())
    return Result("screen_filter", "[ZRB04] Figure 6: the screen-space filter", figures, claims, images, (MEANING,))
