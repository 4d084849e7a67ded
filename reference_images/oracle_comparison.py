"""Compare a rendered scene with the float64 oracle: decisions are equal outside its margin, and values close."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scene_files import Scene

from splatcl import Frame, oracle

MARGIN_UNITS = {"single": 32.0, "double": 32.0 * 2.0**-29}
"""Pixels with a smaller margin are masked: rounding may flip their decisions (tests/tolerances.py)."""

ALLOWED = {"depth": 2e-6, "albedo": 1e-5, "normal": 1e-5, "color": 5e-5}
"""Largest errors, relative for depth, absolute for the others. Phong's power amplifies those of color."""


@dataclass(frozen=True)
class Comparison:
    """The differences of a frame from the oracle.

    Parameters
    ----------
    covered, masked : int
        Number of pixels that a splat covers, and of those with a margin too small to compare.
    errors : dict of str to float
        Largest error of each kind of `ALLOWED` over the compared pixels.
    problems : tuple of str
        Differences beyond the bounds; empty if frame and oracle agree.
    """

    covered: int
    masked: int
    errors: dict[str, float]
    problems: tuple[str, ...]

    def record(self) -> dict[str, Any]:
        """Return the entry of NAME.json."""
        return {"covered": self.covered, "masked": self.masked} | {k: float(f"{e:.2g}") for k, e in self.errors.items()}

    def __str__(self) -> str:
        errors = " ".join(f"{name} {error:.1e}" for name, error in self.errors.items())
        return f"{self.covered:5} covered {self.masked:4} masked  {errors}"


def compare(scene: Scene, frame: Frame) -> Comparison:
    """Render `scene` with the oracle and compare `frame` with it."""
    want = oracle.passes(scene.splats, scene.camera, scene.settings, frame.metadata["epsilon"])
    covered, least = want["weight"] > 0, MARGIN_UNITS[scene.settings.precision]
    sure, sure_id = want["margin"] >= least, want["id_margin"] >= least
    hit = np.isfinite(want["Z"])
    decisions = {
        "count": (frame["count"] == want["count"]) | ~sure,
        "coverage": ((frame["weight"] > 0) == covered) | ~sure,
        "Z's coverage": (np.isfinite(frame["Z"]) == hit) | ~sure,
        "particleid": (frame["particleid"] == want["particleid"]) | ~sure_id,
    }
    problems = [
        f"{name} differs at {np.count_nonzero(~same)} pixels" for name, same in decisions.items() if not same.all()
    ]
    errors = {
        "depth": _largest(frame["Z"], want["Z"], sure & hit, relative=True),
        "albedo": _largest(frame["albedo"], want["albedo"], sure & covered),
        "normal": _largest(frame["N"], want["N"], sure & covered),
        "color": _largest(frame.color, want["color"], sure & covered),
    }
    problems += [
        f"{name} is off by {e:.2g}, over {ALLOWED[name]:g}" for name, e in errors.items() if not e <= ALLOWED[name]
    ]
    masked = int(np.count_nonzero(covered & ~sure))
    return Comparison(int(np.count_nonzero(covered)), masked, errors, tuple(problems))


def _largest(got: NDArray[Any], want: NDArray[Any], where: NDArray[np.bool_], relative: bool = False) -> float:
    """Return the largest error over the pixels `where`, or NaN if any error is NaN."""
    error = np.abs(got[where] - want[where])
    return float((error / np.abs(want[where]) if relative else error).max(initial=0.0))
