"""Fragments for each pixel ([BHZK05] Table 1): what deferred shading saves and the pre-filter costs."""

from __future__ import annotations

import numpy as np

from splatcl.apps.paper.experiment import Claim, Figure, Result, Run
from splatcl.apps.paper.scenes import scan
from splatcl.apps.sample_scenes import frame_camera, resampled

SIZE = 512
SIZES = (10_000, 30_571, 120_000, 480_000)
"""Splats; the second is the bundled scan as it is."""
MEANING = "Fragments are those that are accumulated; saved are all but one of a pixel, with the pre-filter."
FILTERS = {"without pre-filter": "none", "with it": "min"}


def overdraw(run: Run) -> Result:
    """Count the fragments that are accumulated, for the bundled scan in several numbers of splats."""
    whole, notes = scan()
    side = run.pixels(SIZE)
    figures, per_pixel = [], []
    for size in SIZES:
        splats = resampled(whole, run.number(size))
        camera = frame_camera(splats, side, side)
        counts = {name: run.render(splats, camera, prefilter=given)["count"] for name, given in FILTERS.items()}
        row = f"{len(splats):,} splats"
        shares = {name: float(count.sum(dtype=np.int64)) / np.count_nonzero(count) for name, count in counts.items()}
        figures += [Figure(row, f"fragments per covered pixel {name}", share) for name, share in shares.items()]
        saved = 100 - 100 / shares["with it"]
        figures.append(Figure(row, "lighting evaluations saved", saved, "%"))
        per_pixel.append(shares)
    least = min(one["with it"] for one in per_pixel)
    growth = [one["with it"] / one["without pre-filter"] for one in per_pixel]
    claims = (
        Claim(
            "Deferred shading avoids most lighting: each pixel is lit once, and not each fragment.",
            f"{least:.1f} to {max(one['with it'] for one in per_pixel):.1f} fragments fall on a covered pixel, so "
            f"that {100 - 100 / least:.0f}% or more of the evaluations are saved.",
            bool(least > 1.5),
        ),
        Claim(
            "The pre-filter adds fragments as splats become as small as pixels.",
            f"It multiplies fragments by {growth[0]:.2f} for the largest splats and {growth[-1]:.2f} for the smallest.",
            bool(growth[-1] > growth[0] >= 1),
        ),
    )
    title = "[BHZK05] Table 1: fragments per covered pixel"
    return Result("overdraw", title, tuple(figures), claims, notes=(MEANING, *notes))
