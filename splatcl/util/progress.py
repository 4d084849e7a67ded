"""Progress on a terminal for what takes longer than about two seconds; silent and nearly free otherwise."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

DELAY = 2.0
"""Seconds before a stage shows itself."""

Advance = Callable[[int], None]

_screen = threading.Lock()
"""Held by the one stage that may draw: inner and concurrent stages stay silent."""


@contextmanager
def stage(title: str, total: int | None = None) -> Iterator[Advance]:
    """Show a progress bar on stderr while the block runs.

    Nothing is drawn unless stderr is a terminal and the block has run for `DELAY` seconds. A stage inside
    another, or in another thread while one is on, stays silent. The bar is removed at the end.

    Parameters
    ----------
    title : str
        What is being done: "Estimating normals".
    total : int, optional
        Number of steps; without it the bar only shows that something goes on.

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
    """A rich progress bar that starts itself after `DELAY` seconds, unless stopped before."""

    def __init__(self, title: str, total: int | None) -> None:
        self._title, self._total, self._done = title, total, 0
        self._progress: Any = None
        self._timer = threading.Timer(DELAY, self._show)
        self._timer.daemon = True
        self._timer.start()

    def advance(self, steps: int) -> None:
        self._done += steps
        if self._progress is not None:
            self._progress.update(self._progress.task_ids[0], completed=self._done)

    def stop(self) -> None:
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
