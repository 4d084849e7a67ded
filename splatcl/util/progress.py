"""Progress bars on a terminal, for stages longer than two seconds; other stages are silent and nearly free."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

DELAY = 2.0
"""Seconds before a stage shows its bar."""

Advance = Callable[[int], None]
"""Function that counts steps as done."""

_screen = threading.Lock()
"""Lock of the stage that may draw: inner and concurrent stages stay silent."""


@contextmanager
def stage(title: str, total: int | None = None) -> Iterator[Advance]:
    """Show a progress bar on stderr while the block runs.

    The bar appears if stderr is a terminal and the block has run for `DELAY` seconds, and is removed at the end.
    An inner stage, or one in another thread, stays silent while a stage is on.

    Parameters
    ----------
    title : str
        The activity: "Estimating normals".
    total : int, optional
        Number of steps; without it the bar shows activity only.

    Yields
    ------
    advance : callable
        ``advance(steps)`` counts steps as done.

    Examples
    --------
    >>> with stage("Counting", total=3) as advance:
    ...     for _ in range(3):
    ...         advance(1)
    """
    if sys.stderr is None or not sys.stderr.isatty() or not _screen.acquire(blocking=False):
        yield lambda steps: None
        return
    bar = _DelayedBar(title, total)
    try:
        yield bar.advance
    finally:
        bar.stop()
        _screen.release()


class _DelayedBar:
    """A rich progress bar that starts itself after `DELAY` seconds, unless it was stopped."""

    def __init__(self, title: str, total: int | None) -> None:
        self._title, self._total, self._done = title, total, 0
        self._progress: Any = None
        self._timer = threading.Timer(DELAY, self._show)
        self._timer.daemon = True
        self._timer.start()

    def advance(self, steps: int) -> None:
        """Count steps as done."""
        self._done += steps
        if self._progress is not None:
            self._progress.update(self._progress.task_ids[0], completed=self._done)

    def stop(self) -> None:
        """Remove the bar, or keep it from starting."""
        self._timer.cancel()
        self._timer.join()
        if self._progress is not None:
            self._progress.stop()

    def _show(self) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

        columns = (TextColumn("{task.description}", markup=False), BarColumn(), TimeElapsedColumn())
        progress = Progress(*columns, console=Console(stderr=True), transient=True)
        progress.add_task(self._title, total=self._total, completed=self._done)
        progress.start()
        self._progress = progress
