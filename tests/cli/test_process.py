"""The command line as a separate process: exit statuses, pipes, interrupts, imports."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from importlib.metadata import version
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pytest

from splatcl.cli import FAILED, INTERRUPTED, MISTAKE
from splatcl.io.exr import read_exr

COMMAND = [sys.executable, "-c", "import sys, splatcl.cli; sys.exit(splatcl.cli.main())"]


def run_process(command, **kwargs):
    """Run the command in a separate process."""
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE} | kwargs
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    return subprocess.run([*COMMAND, *command.split()], text=True, timeout=120, env=environment, **pipes)


def test_process_renders_a_file_of_bare_points(tmp_path):
    y, x = np.mgrid[-1:1:21j, -1:1:21j]
    points = np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], axis=1)
    np.savetxt(tmp_path / "s.xyz", points)
    result = run_process("render s.xyz -o o.exr --png o.png --size 64x48 --elevation 10", cwd=tmp_path)
    assert (result.returncode, result.stderr) == (0, "")
    assert "note: estimated" in result.stdout and "wrote o.png" in result.stdout
    assert sorted(p.name for p in tmp_path.iterdir()) == ["o.exr", "o.png", "s.xyz"]
    aovs, camera, metadata = read_exr(tmp_path / "o.exr")
    assert camera is not None and metadata["epsilon"] > 0
    depth = np.linalg.norm(camera.position)  # the origin is in the middle of the image
    assert aovs["Z"][24, 32] == pytest.approx(depth, rel=0.01)
    assert iio.imread(tmp_path / "o.png")[24, 32, 3] == 255


def test_process_mistake_is_one_line_without_traceback(tmp_path):
    result = run_process("render missing.ply -o out.jpg", cwd=tmp_path)
    assert (result.returncode, result.stdout) == (MISTAKE, "")
    assert result.stderr == "splatcl: error: out.jpg: cannot write .jpg; use .exr or .png\n"
    assert list(tmp_path.iterdir()) == []


def test_process_version_and_help():
    assert run_process("--version").stdout == f"splatcl {version('splatcl')}\n"
    result = run_process("--help")
    assert (result.returncode, result.stderr) == (0, "")
    for name, text in [
        ("render", "Render a scan"),
        ("info", "Summarize a scan"),
        ("devices", "List the OpenCL"),
    ]:
        assert name in result.stdout and text in result.stdout
    result = run_process("render --help")
    assert result.returncode == 0 and "--prefilter-radius" in result.stdout
    assert "--lights" not in result.stdout


def test_the_installed_command_runs():
    command = [Path(sys.executable).parent / "splatcl", "--version"]
    assert subprocess.run(command, capture_output=True, text=True).stdout.startswith("splatcl ")


def test_the_package_runs_as_a_module():
    command = [sys.executable, "-m", "splatcl", "--version"]
    assert subprocess.run(command, capture_output=True, text=True).stdout.startswith("splatcl ")


def test_process_broken_pipe_is_quiet():
    read_end, write_end = os.pipe()
    os.close(read_end)
    results = [run_process(command, stdout=write_end) for command in ("--help", "devices")]
    os.close(write_end)
    assert [(r.returncode, r.stderr) for r in results] == [(FAILED, "")] * 2


def test_process_full_stdout_is_an_error():
    with Path("/dev/full").open("w") as full:
        result = run_process("devices", stdout=full)
    assert (result.returncode, result.stderr.count("\n")) == (FAILED, 1)
    assert result.stderr.startswith("splatcl: error: ") and "No space left" in result.stderr


INTERRUPTED_RUN = """
import sys, time, splatcl.io.read, splatcl.cli
def read(*args):
    print("reading", flush=True)
    time.sleep(60)
class Renderer:
    def __init__(self, **kwargs): pass
splatcl.io.read.read, splatcl.Renderer = read, Renderer
sys.exit(splatcl.cli.main(["render", "s.ply", "-o", "o.exr"]))
"""


def test_process_interrupt_is_quiet_and_130(tmp_path):
    command = [sys.executable, "-c", INTERRUPTED_RUN]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen(command, cwd=tmp_path, text=True, **pipes) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "reading\n"
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=20)
    assert (process.returncode, err) == (INTERRUPTED, "")
    assert list(tmp_path.iterdir()) == []


def test_help_imports_nothing_heavy():
    code = "import sys, splatcl.cli; splatcl.cli.main(['--help']); print(sorted(sys.modules), file=sys.stderr)"
    start = time.perf_counter()
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert time.perf_counter() - start < 3  # 0.3 s on an idle machine
    for module in ("pyopencl", "scipy", "OpenEXR", "imageio", "plyfile", "trimesh", "skimage"):
        assert f"'{module}'" not in result.stderr, module
