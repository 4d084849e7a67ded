"""Times of what is compared, taken turn by turn, so that the machine's moods meet all of it alike."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from splatcl.util.progress import Advance

MIN_FRAMES = 3
"""Samples that even the slowest configuration gets."""

Seconds = Mapping[str, float]


@dataclass(frozen=True)
class Spread:
    """Samples of one time, seconds, in the order they were taken."""

    samples: tuple[float, ...]

    @property
    def median(self) -> float:
        """Seconds."""
        return float(np.median(self.samples))

    @property
    def quartiles(self) -> tuple[float, float]:
        """Seconds: a quarter of the samples is below the first, a quarter above the second."""
        low, high = np.quantile(self.samples, (0.25, 0.75))
        return float(low), float(high)

    @property
    def minimum(self) -> float:
        """Seconds."""
        return min(self.samples)

    def as_json(self) -> dict[str, Any]:
        """Return everything, in seconds."""
        low, high = self.quartiles
        return {"median": self.median, "q1": low, "q3": high, "min": self.minimum, "samples": list(self.samples)}


def seconds_of(work: Callable[[], object]) -> float:
    """Return how long a call takes."""
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def turn_by_turn(
    jobs: Sequence[Callable[[], Seconds]], rounds: int, max_seconds: float, advance: Advance
) -> list[dict[str, Spread]]:
    """Run every job once a round, and return the spread of each of the times that each returns.

    Parameters
    ----------
    jobs : sequence of callable
        Each returns times by name.
    rounds : int
        Samples of each.
    max_seconds : float
        After that many seconds no further round starts, from the `MIN_FRAMES`th on.
    advance : callable
        Of `progress.stage`, called with 1 after each job.
    """
    samples: list[list[Seconds]] = [[] for _ in jobs]
    start = time.perf_counter()
    for done in range(rounds):
        if done >= MIN_FRAMES and time.perf_counter() - start > max_seconds:
            break
        for job, taken in zip(jobs, samples, strict=True):
            taken.append(job())
            advance(1)
    return [{name: Spread(tuple(one[name] for one in taken)) for name in taken[0]} for taken in samples]
