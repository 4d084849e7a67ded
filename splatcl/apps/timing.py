"""Time the candidates in turn, so that load on the machine affects all of them equally."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from splatcl.util.progress import Advance

MIN_FRAMES = 3
"""Least number of samples of a job."""

Seconds = Mapping[str, float]
"""Times by name, seconds."""


@dataclass(frozen=True)
class Spread:
    """Samples of one time, seconds, in the order of measurement."""

    samples: tuple[float, ...]

    @property
    def median(self) -> float:
        """Median of the samples, seconds."""
        return float(np.median(self.samples))

    @property
    def quartiles(self) -> tuple[float, float]:
        """First and third quartile of the samples, seconds."""
        low, high = np.quantile(self.samples, (0.25, 0.75))
        return float(low), float(high)

    @property
    def minimum(self) -> float:
        """Least sample, seconds."""
        return min(self.samples)

    def as_json(self) -> dict[str, Any]:
        """Return the statistics and the samples as JSON's types, seconds."""
        low, high = self.quartiles
        return {"median": self.median, "q1": low, "q3": high, "min": self.minimum, "samples": list(self.samples)}


def seconds_of(work: Callable[[], object]) -> float:
    """Return the duration of a call, seconds."""
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def turn_by_turn(
    jobs: Sequence[Callable[[], Seconds]], rounds: int, max_seconds: float, advance: Advance
) -> list[dict[str, Spread]]:
    """Run all jobs in turn, once in each round; return the spreads of each job's times.

    Parameters
    ----------
    jobs : sequence of callable
        Functions that return times by name, seconds.
    rounds : int
        Number of rounds: samples of each time.
    max_seconds : float
        Time after which no round starts, seconds; `MIN_FRAMES` rounds always run.
    advance : callable
        The function of `progress.stage`; it is called with 1 after each job.
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
