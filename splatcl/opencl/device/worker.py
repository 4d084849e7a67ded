"""A worker that renders for a process forked after OpenCL had started.

The threads of an OpenCL runtime do not survive a fork, so a forked process would wait for them forever. It sends its
work to a new interpreter instead, over a pair of pipes.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import threading
from collections.abc import Callable
from typing import Any

from splatcl.errors import DeviceError


class Worker:
    """A new interpreter that uses OpenCL; it ends when this process does."""

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self.process = subprocess.Popen(
            [sys.executable, "-c", "from splatcl.opencl.device.worker import main; main()"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )

    def call(
        self, factory: Callable[..., Any], arguments: tuple[Any, ...], function: Callable[..., Any], *args: Any
    ) -> Any:
        """Return ``factory(*arguments).call(function, *args)`` from the worker; it keeps the factory's objects."""
        with self.lock:
            assert self.process.stdin and self.process.stdout
            try:
                pickle.dump((factory, arguments, function, args), self.process.stdin)
                self.process.stdin.flush()
                result = pickle.load(self.process.stdout)
            except (BrokenPipeError, EOFError):
                raise DeviceError("the renderer of this forked process ended; see its messages above") from None
        if isinstance(result, Exception):
            raise result
        return result


_workers: dict[int, Worker] = {}
_starting = threading.Lock()


def worker() -> Worker:
    """Return this process's own worker; start it at the first call."""
    with _starting:
        if os.getpid() not in _workers:
            _workers[os.getpid()] = Worker()
        return _workers[os.getpid()]


def main() -> None:
    """Run the jobs that arrive on standard input until it closes."""
    jobs, results = sys.stdin.buffer, os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # a runtime's own output must not mix with the results
    made: dict[Any, Any] = {}
    while True:
        try:
            factory, arguments, function, args = pickle.load(jobs)
        except EOFError:
            return
        try:
            if (factory, arguments) not in made:
                made[factory, arguments] = factory(*arguments)
            result = made[factory, arguments].call(function, *args)
        except Exception as error:
            result = error
        pickle.dump(result, results)
        results.flush()
