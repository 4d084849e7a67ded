"""Devices: choice, refusal, and work in awkward processes (fork, threads, no home, one core)."""

from __future__ import annotations

import multiprocessing
import os
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from importlib.resources import files

import numpy as np
import pytest

import splatcl
from splatcl.errors import DeviceError
from splatcl.opencl.device import devices, program
from splatcl.opencl.device.strictness import FLAG_VARIABLES

SPLATS = splatcl.Splats(np.zeros((1, 3)), np.eye(3)[:1], np.eye(3)[1:2])
CAMERA = splatcl.Camera.look_at((0, 0, 3), (0, 0, 0), width=33, height=17)
CULL = splatcl.RenderSettings(facing="cull")  # one layer alone halves the programs to build
SCRIPT = """
import numpy as np, splatcl
splats = splatcl.Splats(np.zeros((1, 3)), np.eye(3)[:1], np.eye(3)[1:2])
camera = splatcl.Camera.look_at((0, 0, 3), (0, 0, 0), width=33, height=17)
print(splatcl.render(splats, camera, splatcl.RenderSettings(facing="cull"))["Z"].min())
"""


def nearest(_=None) -> float:
    return float(splatcl.render(SPLATS, CAMERA, CULL)["Z"].min())


def run_script(script: str = SCRIPT, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", script],
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


def test_the_default_is_pocl_on_the_cpu():
    first = devices.list_devices()[0]
    assert first.is_default and "Portable Computing Language" in first.platform
    assert devices.choose_device().index == 0
    assert sum(d.is_default for d in devices.list_devices()) == 1


@pytest.mark.parametrize("wanted", ["0", 0, "pocl", "POCL 3", "portable computing"])
def test_a_device_is_chosen_by_index_or_words(wanted):
    assert devices.choose_device(wanted).index == 0


def test_the_environment_chooses_and_an_argument_goes_first(monkeypatch):
    monkeypatch.setenv("SPLATCL_DEVICE", "no such thing")
    with pytest.raises(DeviceError, match="no OpenCL device fits 'no such thing'; choose one of 0: "):
        devices.choose_device()
    assert devices.choose_device("pocl").index == 0


@pytest.mark.parametrize("wanted", ["99", "-1", "warp drive"])
def test_an_unknown_device_is_refused_with_the_choices(wanted):
    with pytest.raises(DeviceError, match="choose one of 0: "):
        devices.choose_device(wanted)


def fake_device(platform: str, version: str, is_cpu: bool = True):
    import pyopencl as cl

    kind = cl.device_type.CPU if is_cpu else cl.device_type.GPU
    names = {"platform": type("P", (), {"name": platform, "version": version}), "type": kind}
    return type("D", (), names)


def test_pocl_goes_first_and_the_newest_pocl_before_others():
    pocl30 = fake_device("Portable Computing Language", "OpenCL 3.0 PoCL 3.0-rc2")
    pocl31 = fake_device("Portable Computing Language", "OpenCL 3.0 PoCL 3.1+debian")
    pocl5 = fake_device("Portable Computing Language", "OpenCL 3.0 PoCL 5.0")
    gpu = fake_device("NVIDIA CUDA", "OpenCL 3.0 CUDA 12", is_cpu=False)
    intel = fake_device("Intel(R) OpenCL", "OpenCL 3.0 LINUX")
    order = sorted([gpu, intel, pocl30, pocl5, pocl31], key=devices._preference)
    assert order == [pocl5, pocl31, pocl30, intel, gpu]


@pytest.mark.parametrize("variable", FLAG_VARIABLES)
def test_injected_compiler_flags_are_refused(monkeypatch, variable):
    monkeypatch.setenv(variable, "-cl-fast-relaxed-math")
    with pytest.raises(DeviceError, match=f"{variable} injects compiler flags"):
        splatcl.Renderer()


def test_no_platform_at_all_is_one_clear_error(monkeypatch):
    monkeypatch.setattr(devices, "list_devices", list)
    with pytest.raises(DeviceError, match="no OpenCL device; pip install"):
        devices.choose_device()


def test_a_build_error_names_the_real_file_and_line(monkeypatch):
    real = program.inline_source
    broken = "  region_sums t;"
    monkeypatch.setattr(program, "inline_source", lambda *a: real(*a).replace(broken, "  region_sums t oops;"))
    line = 1 + next(
        i
        for i, text in enumerate((files("splatcl.kernels") / "passes/attributes.cl").read_text().splitlines())
        if broken in text
    )
    with pytest.raises(DeviceError, match=rf"kernels/passes/attributes.cl:{line}:"):
        splatcl.Renderer(tile_size=64).render(SPLATS, CAMERA)


def test_an_image_beyond_the_device_is_refused(monkeypatch):
    renderer = splatcl.Renderer()
    monkeypatch.setattr(renderer._device, "largest_buffer", 33 * 17 * 4)
    with pytest.raises(DeviceError, match="use a smaller image or fewer splats"):
        renderer.render(SPLATS, CAMERA)


@pytest.mark.parametrize(
    "kwargs", [{"tile_size": 7}, {"lanes": 3}, {"lanes": 32}, {"mapping": "row"}, {"lanes": 4, "mapping": "pixel"}]
)
def test_sizes_the_kernels_do_not_have_are_refused(kwargs):
    with pytest.raises(splatcl.SplatclError, match=next(iter(kwargs))):
        splatcl.Renderer(**kwargs)


def in_child(queue):
    try:
        queue.put(nearest())
    except Exception as error:  # the parent's assertion shows the error
        queue.put(repr(error))


def test_a_process_forked_after_a_render_renders_too():
    expected = nearest()
    context = multiprocessing.get_context("fork")
    queue = context.Queue()
    child = context.Process(target=in_child, args=(queue,))
    child.start()
    try:
        assert queue.get(timeout=60) == expected
    finally:
        child.kill()
        child.join()


def test_a_frame_from_before_the_fork_is_refused_in_the_child(monkeypatch):
    frame = splatcl.render(SPLATS, CAMERA)
    frame["Z"]
    monkeypatch.setattr(devices, "_opened_by", os.getpid() + 1)
    assert frame["Z"].min() == pytest.approx(3, rel=1e-6)
    with pytest.raises(DeviceError, match="cannot read the frame's N in a forked process: read it before the fork"):
        frame["N"]


def test_a_forked_process_gets_the_worker_s_errors(monkeypatch):
    monkeypatch.setattr(devices, "_opened_by", os.getpid() + 1)
    assert splatcl.Renderer().render(SPLATS, CAMERA)["Z"].min() == pytest.approx(3, rel=1e-6)
    with pytest.raises(DeviceError, match="no such device"):
        splatcl.Renderer("no such device").render(SPLATS, CAMERA)


def test_threads_share_a_renderer():
    barrier = threading.Barrier(4)

    def job(i: int) -> bytes:
        barrier.wait(timeout=60)
        camera = splatcl.Camera.look_at((0, 0, 3 + i % 2), (0, 0, 0), width=64, height=64)
        return splatcl.render(SPLATS, camera).color.tobytes()

    with ThreadPoolExecutor(4) as pool:
        images = list(pool.map(job, range(4)))
    assert images[0] == images[2] and images[1] == images[3] and images[0] != images[1]


def test_two_processes_render_at_once():
    processes = [subprocess.Popen([sys.executable, "-c", SCRIPT], stdout=subprocess.PIPE) for _ in range(2)]
    assert [float(p.communicate(timeout=120)[0]) for p in processes] == [nearest()] * 2


def test_a_read_only_home_and_no_cache_folder_work(tmp_path, monkeypatch):
    monkeypatch.delenv("POCL_CACHE_DIR", raising=False)
    result = run_script(HOME="/proc/nowhere", XDG_CACHE_HOME="/proc/nowhere", TMPDIR=str(tmp_path))
    assert result.returncode == 0, result.stderr
    assert float(result.stdout) == nearest()


def test_one_core_works():
    pinned = "import os; os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})\n" + SCRIPT
    result = run_script(pinned)
    assert result.returncode == 0, result.stderr
    assert float(result.stdout) == nearest()


def test_one_upload_serves_two_renderers():
    first, second = splatcl.Renderer(lanes=1), splatcl.Renderer(lanes=4, tile_size=32)
    resident = first.upload(SPLATS)
    images = [renderer.render(resident, CAMERA).color for renderer in (first, second, first)]
    assert np.array_equal(images[0], images[1]) and np.array_equal(images[0], images[2])
