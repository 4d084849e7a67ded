"""Errors of 8 and 16 bits: formats of render targets ([BHZK05] figure 2) and of the splats (its section 6)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from splatcl.apps.paper.experiment import Claim, Figure, Result, Run, verdict
from splatcl.apps.paper.metrics import angles, differences, num_levels, psnr
from splatcl.apps.paper.scenes import ramp, scan
from splatcl.apps.sample_scenes import frame_camera
from splatcl.frame import Frame

SIZE = 256
STEP = 1 / 255
"""A level of an 8-bit display."""
TARGETS = {"unorm8": 1.0, "float16": 65504.0, "float32": float(np.finfo(np.float32).max)}
"""Formats of the sums, and the largest number of each."""
MEANING = "Errors are those of colors and normals after the division by the weights, against float32."
VISIBLE = 40.0
"""PSNR, dB, above which two pictures look the same."""


def targets(run: Run) -> Result:
    """Accumulate the same splats in targets of 8, 16 and 32 bits a channel."""
    splats, notes = scan()
    splats = ramp(splats)
    camera = frame_camera(splats, run.pixels(SIZE), run.pixels(SIZE))
    frames = {name: run.render(splats, camera, target=name) for name in TARGETS}
    reference = frames["float32"]
    covered = reference.color[..., 3] > 0
    figures: list[Figure] = []
    measured: dict[str, dict[str, float]] = {}
    for name, frame in frames.items():
        largest, mean = differences(frame["albedo"], reference["albedo"], covered)
        measured[name] = one = {
            "largest error": largest / STEP,
            "mean error": mean / STEP,
            "different weights": num_levels(frame["weight"][covered]),
            "saturated pixels": 100 * float(np.mean(frame["weight"][covered] >= TARGETS[name])),
            "mean error of normals": float(np.nanmean(angles(frame["N"][covered], reference["N"][covered]))),
        }
        units = ("/255", "/255", "", "%", "degrees")
        figures += [Figure(name, *item, unit) for item, unit in zip(one.items(), units, strict=True)]
    low, half = measured["unorm8"], measured["float16"]
    claims = (
        Claim(
            "Sums in 8 bits a channel overflow, and colors and shading show bands.",
            f"{low['saturated pixels']:.0f}% of the pixels saturate, {low['different weights']:.0f} of "
            f"{measured['float32']['different weights']:.0f} different weights remain, colors are off by up to "
            f"{low['largest error']:.0f}/255, normals by {low['mean error of normals']:.2g} degrees on average.",
            verdict(low["saturated pixels"] > 1 and low["largest error"] > 8),
        ),
        Claim(
            "Floating-point targets of 16 bits avoid this.",
            f"No color is off by more than {half['largest error']:.2g}/255 from 32 bits; "
            f"{half['saturated pixels']:.0f}% of the pixels saturate.",
            verdict(half["largest error"] < 1 and not half["saturated pixels"]),
        ),
    )
    title = "[BHZK05] Figure 2: targets of 8, 16 and 32 bits"
    return Result("targets", title, tuple(figures), claims, dict(frames), (MEANING, *notes))


def half_inputs(run: Run) -> Result:
    """Round the splats' centers and normals to 16 bits."""
    splats, notes = scan()
    splats = ramp(splats)
    camera = frame_camera(splats, run.pixels(SIZE), run.pixels(SIZE))
    full, half = (run.render(splats, camera, half_inputs=given) for given in (False, True))
    both = (full.color[..., 3] > 0) & (half.color[..., 3] > 0) & np.isfinite(full["Z"]) & np.isfinite(half["Z"])
    size = 2 * splats.bounding_sphere[1]
    figures: list[Figure] = []
    errors: dict[str, tuple[Any, float, str]] = {
        "color": (np.abs(half.color - full.color)[both][:, :3], 1 / STEP, "/255"),
        "depth": (np.abs(half["Z"][both].astype(np.float64) - full["Z"][both]), 100 / size, "% of the model"),
        "normal": (angles(half["N"][both], full["N"][both]), 1.0, "degrees"),
    }
    for name, (error, scale, unit) in errors.items():
        figures.append(Figure(name, "largest error", scale * float(error.max()), unit))
        figures.append(Figure(name, "mean error", scale * float(error.mean()), unit))
    changed = 100 * float(np.mean((full.color[..., 3] > 0) != (half.color[..., 3] > 0)))
    quality = psnr(half.color[..., :3], full.color[..., :3])
    figures += [Figure("picture", "PSNR", quality, "dB"), Figure("picture", "pixels gained or lost", changed, "%")]
    claims = (
        Claim(
            "Centers and normals may be stored in 16 bits without a visible loss.",
            f"PSNR {quality:.1f} dB; colors change by {figures[1]} on average, normals by {figures[5]}.",
            verdict(quality >= VISIBLE),
        ),
    )
    apart = np.where(both[..., None], 16 * np.abs(half.color - full.color)[..., :3], 0)
    images: dict[str, Frame | NDArray[Any]] = {"32 bits": full, "16 bits": half, "difference x 16": apart}
    title = "[BHZK05] Section 6: centers and normals of 16 bits"
    return Result("half_inputs", title, tuple(figures), claims, images, notes)
