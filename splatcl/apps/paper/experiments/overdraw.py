"""Fragments for each pixel ([BHZK05] Table 1): the gain of deferred shading and the cost of the pre-filter."""

from __future__ import annotations

import numpy as np

from splatcl.apps.paper.experiment import Claim, Figure, Result, Run, verdict
from splatcl.apps.paper.scenes import scan
from splatcl.apps.sample_scenes import frame_camera, resampled

SIZE = 512
SIZES = (10_000, 30_571, 120_000, 480_000)
"""Numbers of splats. The second is that of the bundled scan."""
MEANING = "Only accumulated fragments count. Saved evaluations are all but one of each pixel, with the pre-filter."
FILTERS = {"without pre-filter": "none", "with it": "min"}


def overdraw(run: Run) -> Result:
    """Count the accumulated fragments of the bundled scan, for several numbers of splats."""
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
            "Deferred shading avoids most lighting, because it lights each pixel once instead of each fragment.",
            f"A covered pixel gets {least:.1f} to {max(one['with it'] for one in per_pixel):.1f} fragments, so at "
            f"least {100 - 100 / least:.0f}% of the evaluations are saved.",
            verdict(bool(least > 1.5)),
        ),
        Claim(
            "The pre-filter adds fragments as splats become as small as pixels.",
            f"It multiplies the fragments by {growth[0]:.2f} for the largest splats and by {growth[-1]:.2f} for the "
            "smallest.",
            verdict(bool(growth[-1] > growth[0] >= 1)),
        ),
    )
    title = "[BHZK05] Table 1: fragments per covered pixel"
    return Result("overdraw", title, tuple(figures), claims, notes=(MEANING, *notes))
