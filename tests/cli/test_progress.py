"""Progress: silent without a terminal or before the delay; after it, a bar on the terminal."""

from __future__ import annotations

import io
import os
import pty
import subprocess
import sys
import time

import pytest

from splatcl.util import progress
from splatcl.util.progress import stage

WORK = """
import sys, time
from splatcl.util import progress
progress.DELAY = float(sys.argv[1])
with progress.stage("Reading [b]a[/b].ply", total=10) as advance:
    for _ in range(10):
        advance(1)
        with progress.stage("An inner stage"):
            time.sleep(0.05)
print("rich" in sys.modules)
"""


def run_on_a_terminal(delay):
    """Run `WORK` with stderr on a pseudo-terminal; return stdout and the terminal's output."""
    controller, terminal = pty.openpty()
    command = [sys.executable, "-c", WORK, str(delay)]
    env = {**os.environ, "TERM": "xterm", "COLUMNS": "80"}
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=terminal, env=env) as process:
        os.close(terminal)
        shown = b""
        while True:
            try:
                chunk = os.read(controller, 4096)
            except OSError:  # Linux raises it when the last writer has closed the terminal
                break
            if not chunk:
                break
            shown += chunk
        stdout = process.stdout.read() if process.stdout else b""
    os.close(controller)
    assert process.returncode == 0, shown
    return stdout.decode().strip(), shown.decode()


def test_a_long_stage_shows_a_bar_on_a_terminal_and_removes_it():
    stdout, shown = run_on_a_terminal(0.1)
    assert stdout == "True"
    assert "Reading [b]a[/b].ply" in shown and "━" in shown
    assert "An inner stage" not in shown
    assert shown.rstrip("\r\n").endswith("\x1b[2K")  # the last action clears the line


def test_a_short_stage_shows_nothing_and_never_imports_rich():
    assert run_on_a_terminal(60.0) == ("False", "")


def test_without_a_terminal_nothing_is_shown_or_started():
    result = subprocess.run([sys.executable, "-c", WORK, "0.0"], capture_output=True, text=True, check=True)
    assert (result.stdout.strip(), result.stderr) == ("False", "")


class Terminal(io.StringIO):
    """A stream that says it is a terminal."""

    def isatty(self):
        return True


def test_the_delay_is_about_two_seconds():
    assert 1.5 <= progress.DELAY <= 3


def test_an_error_inside_ends_the_bar_and_frees_the_screen(monkeypatch):
    monkeypatch.setattr(sys, "stderr", Terminal())
    monkeypatch.setattr(progress, "DELAY", 0.0)
    with pytest.raises(KeyError), stage("Reading"):
        time.sleep(0.05)
        raise KeyError
    assert progress._screen.acquire(blocking=False)
    progress._screen.release()


def test_steps_before_and_after_the_bar_appears_are_counted(monkeypatch):
    monkeypatch.setattr(sys, "stderr", Terminal())
    monkeypatch.setattr(progress, "DELAY", 0.0)
    bar = progress._DelayedBar("Reading", 10)
    bar.advance(3)
    bar._timer.join()
    bar.advance(4)
    assert bar._progress.tasks[0].completed == 7 and bar._progress.tasks[0].total == 10
    bar.stop()


def test_no_stderr_at_all_is_fine(monkeypatch):
    monkeypatch.setattr(sys, "stderr", None)
    with stage("Reading") as advance:
        advance(1)
