"""The benchmark: what it counts, computes, prints and writes. No test looks at a time's size."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import get_args

import imageio.v3 as imageio
import numpy as np
import pyopencl as cl
import pytest

import splatcl
from splatcl.bench import against, guard, matrix, measure, plot, roofline, scenes
from splatcl.bench.matrix import BASE, Row, base_of, only, parse_sizes, rows, size_name
from splatcl.bench.measure import Drawn, Fragments, Job, Result, Skipped
from splatcl.bench.passes import PASSES, Counts, FramePasses, lanes_of
from splatcl.bench.roofline import Limits, Roofline, measure_limits
from splatcl.bench.timing import MIN_FRAMES, Spread, turn_by_turn
from splatcl.bench.work import FLOPS, limits_of, work_of
from splatcl.cli import main
from splatcl.errors import FileError, SettingsError, SplatclError
from splatcl.settings import Shader

ROOT = Path(__file__).parent.parent
SMALL = 1 << 20
STUB = """
import time
import numpy as np
class Backend:
    renderer_name = "stub"
    def __init__(self, splats, sort=True): self.num, self.drawn = len(splats), 0
    def draw(self, camera, settings): self.drawn += 1; self.size = camera.height, camera.width
    def read(self): return {"color": np.ones((*self.size, 4), np.float32)}
"""


@pytest.fixture
def quick_limits(monkeypatch):
    """Measure the machine's limits on a buffer that fits caches."""
    monkeypatch.setattr(roofline, "REPETITIONS", 1)
    monkeypatch.setattr(roofline, "measure_limits", partial(measure_limits, num_bytes=SMALL))


@pytest.fixture
def stub_backend(monkeypatch, tmp_path):
    """Put a backend in place of OpenGL's."""
    path = tmp_path / "backend.py"
    path.write_text(STUB)
    monkeypatch.setattr(against, "BACKEND", path)
    return path


def result_of(settings=BASE, **seconds):
    """Return a result with numbers that are easy to follow."""
    row = Row(1000, settings)
    counts = Counts(1000, 600, 900, 800, 700, 400, 500, 50, 36, 12, 48, 64, 32, 4)
    drawn = Drawn(80, 40)
    times = {name: Spread((seconds.get(name, 1.0),)) for name in PASSES}
    return Result(row, settings.facing, counts, Fragments(drawn, drawn, drawn, 100), Spread((2.0,)), times)


# --- scenes


def test_sphere_is_covered_from_outside():
    sphere = scenes.fibonacci_sphere(5000)
    assert sphere.center.dtype == sphere.color.dtype == np.float32
    np.testing.assert_allclose(np.linalg.norm(sphere.center, axis=1), 1, rtol=1e-6)
    np.testing.assert_allclose(sphere.normal, sphere.center, atol=1e-5)
    for tangent in (sphere.tangent_u, sphere.tangent_v):
        np.testing.assert_allclose(np.linalg.norm(tangent, axis=1), 0.9 * math.sqrt(4 * math.pi / 5000), rtol=1e-5)
    np.testing.assert_allclose(sphere.color, 0.5 + 0.5 * sphere.center, atol=1e-6)
    directions = np.random.default_rng(1).normal(size=(1000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    nearest = np.linalg.norm(directions[:, None] - sphere.center, axis=2).min(axis=1)
    assert nearest.max() < sphere.radius[0]


def test_shuffling_keeps_every_splat_whole():
    sphere = scenes.fibonacci_sphere(500)
    mixed = scenes.shuffled(sphere)
    assert not np.array_equal(mixed.center, sphere.center)
    order = np.argsort(-mixed.center[:, 2])
    for name in ("center", "tangent_u", "tangent_v", "color"):
        np.testing.assert_array_equal(getattr(mixed, name)[order], getattr(sphere, name))
    np.testing.assert_array_equal(scenes.shuffled(sphere).center, mixed.center)


@pytest.mark.parametrize("num", [70, 100, 130, 1000, 1234])
def test_a_resampled_scan_is_the_same_surface(num):
    scan = replace(scenes.fibonacci_sphere(100), oriented=False)
    more = scenes.resampled(scan, num)
    assert len(more) == num and not more.oriented
    apart = np.linalg.norm(more.center[:, None] - scan.center, axis=2).min(axis=1)
    assert apart.max() <= scan.radius[0] * (1 + 1e-5)
    area, given = (np.pi * (s.radius**2).sum() for s in (more, scan))
    assert 0.95 * given <= area <= 2 * given
    if num == 100:
        np.testing.assert_array_equal(more.center, scan.center)
        np.testing.assert_allclose(more.radius, scan.radius)


def test_parts_of_discs_leave_no_holes(renderer):
    """Through a hole one would see the far side."""
    scan, settings = scenes.fibonacci_sphere(2000), splatcl.RenderSettings(prefilter="none", epsilon=0.0)
    parts = scenes.resampled(scan, 40_000)
    camera = scenes.frame_camera(scan, 128, 128)
    whole, divided = (renderer.render(s, camera, settings)["Z"] for s in (scan, parts))
    holes = np.isfinite(whole) & (divided > whole + 0.5)
    assert holes.sum() < 0.001 * np.isfinite(whole).sum()


# --- the matrix


def test_matrix_varies_one_factor_at_a_time():
    table = rows(matrix.SIZES)
    assert len({row.name for row in table}) == len(table)
    base = [row for row in table if not row.factor]
    assert [row.num_splats for row in base[::3]] == list(matrix.SIZES)
    assert {row.settings.facing for row in base} == {"keep", "flip", "cull"}
    factors = [row for row in table if row.factor]
    assert {row.num_splats for row in factors} == {1_100_000, 4_000_000}
    assert {row.settings.shader for row in table} == set(get_args(Shader))
    for row in factors:
        differing = [f for f in ("model", "order") if getattr(row, f) != getattr(base_of(row), f)]
        differing += ["size"] if row.width != 512 else []
        differing += [f for f, value in vars(row.settings).items() if value != getattr(BASE, f)]
        assert len(differing) == 1, row.name
        assert base_of(row) in table


def test_factors_are_varied_at_the_largest_of_other_sizes():
    table = rows((300, 500))
    assert {row.num_splats for row in table if row.factor} == {500}


def test_only_keeps_what_a_row_is_compared_with():
    table = rows((300, 500))
    chosen = only(table, "Shuffled")
    assert [row.label for row in chosen] == ["cull", "shuffled"]
    assert [row.label for row in only(table, "keep")] == ["keep", "keep"]
    with pytest.raises(SettingsError, match=r"nothing.*shuffled"):
        only(table, "nothing")


@pytest.mark.parametrize(
    ("text", "sizes"), [("137k", (137_000,)), ("1.1M,300", (300, 1_100_000)), (" 4M , 4M", (4_000_000,))]
)
def test_sizes(text, sizes):
    assert parse_sizes(text) == sizes


def test_size_names():
    assert [size_name(n) for n in (*matrix.SIZES, 300)] == ["137k", "655k", "1.1M", "4M", "8.3M", "14M", "300"]


# --- timing


def test_spread():
    spread = Spread((4.0, 1.0, 2.0, 3.0, 5.0))
    assert (spread.median, spread.quartiles, spread.minimum) == (3.0, (2.0, 4.0), 1.0)
    assert spread.as_json() == {"median": 3, "q1": 2, "q3": 4, "min": 1, "samples": [4, 1, 2, 3, 5]}


def test_jobs_take_turns():
    order, steps = [], []
    jobs = [lambda name=name: (order.append(name), {name: len(order)})[1] for name in "ab"]
    spreads = turn_by_turn(jobs, 3, math.inf, steps.append)
    assert "".join(order) == "ababab" and sum(steps) == 6
    assert [one[name].samples for one, name in zip(spreads, "ab", strict=True)] == [(1, 3, 5), (2, 4, 6)]


def test_slow_jobs_get_fewer_rounds():
    (spreads,) = turn_by_turn([lambda: {"a": 1.0}], 100, -1.0, lambda steps: None)
    assert len(spreads["a"].samples) == MIN_FRAMES


# --- counts


def test_lanes_of_large_boxes():
    boxes = np.array([(0, 0, 4, 1), (3, 1, 4, 2), (10, 0, 20, 0), (10, 0, 20, 0)], np.int16)
    tile = np.array([0, 0, 0, 1])  # the last two are one splat in both tiles that it touches
    # 4x2 blocks from each box' corner: 2x1, 1x1, 2x1; 2x1
    assert lanes_of(boxes, tile, 2, 16, 8) == 8 * (2 + 1 + 2 + 2)
    assert lanes_of(boxes, tile, 2, 16, 4) == 4 * (3 + 1 + 3 + 3)  # 2x2 blocks
    assert lanes_of(boxes, tile, 2, 16, 1) == 10 + 4 + 6 + 5


def test_lanes_of_small_boxes():
    boxes = np.array([(1, 1, 3, 1)] * 5 + [(4, 4, 4, 7), (14, 0, 17, 0), (20, 2, 22, 2), (16, 0, 20, 0)], np.int16)
    tile = np.array([0] * 7 + [1, 1])
    # A vector for each of 3x1 positions, then of 3x4 (the box of 14 to 17 has 2 columns in its tile); a batch with a
    # box of 5 columns goes box by box.
    assert lanes_of(boxes, tile, 2, 16, 4) == 4 * (3 + 12 + (2 + 3))
    assert lanes_of(boxes[:7], tile[:7], 2, 16, 8) == 8 * 12
    nowhere = np.array([(1, 0, 0, 5), (16, 0, 17, 0)], np.int16)
    assert lanes_of(nowhere, np.array([0, 0]), 2, 16, 8) == lanes_of(nowhere[:0], tile[:0], 2, 16, 8) == 0


def facing_discs(rows, size):
    """Return discs parallel to the image of an orthographic camera: x, y and radius in pixels, z, 1 or -1."""
    camera = splatcl.Camera(np.eye(4), size / 2, size / 2, size / 2, size / 2, size, size, projection="orthographic")
    x, y, radius, z, side = np.array(rows, np.float64).T
    none, radius = np.zeros_like(x), radius * 2 / size
    center = np.stack([x * 2 / size - 1, y * 2 / size - 1, z], axis=1)
    u, v = np.stack([radius, none, none], axis=1), np.stack([none, -radius * side, none], axis=1)
    return camera, splatcl.Splats(center, u, v)


def test_counts_of_a_frame_by_hand(renderer):
    """Three facing discs of radius 4.5 pixels: within a tile, over four, and one that shows its back."""
    camera, splats = facing_discs([(8, 8, 4.5, 32, 1), (16, 16, 4.5, 32, 1), (24, 24, 4.5, 32, -1)], 32)
    resident = renderer.upload(splats)
    settings = splatcl.RenderSettings(facing="cull", epsilon=0.0)
    counts = FramePasses(renderer, resident, camera, settings).counts()
    assert (counts.num_splats, counts.num_listed, counts.num_entries) == (3, 2, 5)
    assert (counts.num_discs, counts.num_near) == (5, 5)
    assert counts.num_pixels == 1024 and counts.real_bytes == 4
    assert (counts.plane_bytes, counts.touched_bytes, counts.splat_bytes) == (36, 12, 48)
    assert (counts.record_bytes, counts.attribute_bytes) == (64, 32)
    y, x = np.mgrid[:32, :32] + 0.5
    hits = sum(int(((x - c) ** 2 + (y - c) ** 2 <= 4.5**2).sum()) for c in (8, 16))
    fragments = measure.count_fragments(renderer, resident, camera, settings)
    assert fragments.hits == fragments.drawn.fragments == fragments.without_prefilter.fragments == hits
    assert fragments.drawn.pixels <= hits
    # Blocks of a box of 10x10 and four of 5x5.
    num_blocks = {1: 100 + 4 * 25, 4: 25 + 4 * 9, 8: 15 + 4 * 6, 16: 9 + 4 * 4}[renderer.device.lanes]
    assert counts.visibility_lanes == counts.attribute_lanes == num_blocks * renderer.device.lanes


def test_what_lies_behind_is_not_taken_for_attributes(renderer):
    """A disc that covers the image before a disc that it hides, and one whose half is beside the image."""
    camera, splats = facing_discs([(8, 8, 2, 9, 1), (8, 8, 40, 2, 1), (16, 8, 3, 9, 1)], 16)
    counts = FramePasses(renderer, renderer.upload(splats), camera, splatcl.RenderSettings(epsilon=0.0)).counts()
    assert (counts.num_listed, counts.num_entries, counts.num_discs, counts.num_near) == (3, 3, 3, 1)
    assert 256 <= counts.attribute_lanes < counts.visibility_lanes


def test_counts_agree_with_each_other(renderer):
    row = Row(2000, replace(BASE, facing="keep"), width=64, height=48)
    job = Job(renderer, renderer.upload(scenes.fibonacci_sphere(2000)), row)
    counts = job.counts
    assert counts.num_listed == 2000 <= counts.num_entries
    assert 0 < counts.num_near <= counts.num_entries and 0 < counts.num_discs <= counts.num_entries
    assert counts.attribute_lanes >= job.fragments.drawn.fragments and counts.visibility_lanes >= job.fragments.hits
    fragments = job.fragments
    assert fragments.drawn == fragments.with_prefilter
    assert fragments.drawn.fragments > fragments.without_prefilter.fragments
    assert fragments.hits > 1.5 * fragments.without_prefilter.fragments  # the back too
    times = job.times()
    assert list(times) == ["frame", *PASSES] and min(times.values()) > 0


# --- limits


def test_work_by_hand():
    settings = replace(BASE, lights=matrix.THREE_LIGHTS)
    work = work_of(result_of(settings))
    assert vars(work["bin"]) == {
        "read_bytes": 1000 * 36 + 600 * 12,
        "written_bytes": 600 * 12 + 900 * 4,
        "flops": 1000 * (FLOPS["splat"] + FLOPS["culled splat"]) + 600 * FLOPS["listed"],
    }
    assert vars(work["project"]) == {
        "read_bytes": 900 * (4 + 48),
        "written_bytes": 900 * (64 + 32 + 8 + 8),
        "flops": 900 * FLOPS["entry"],
    }
    assert vars(work["visibility"]) == {
        "read_bytes": 900 * 4 + 800 * (64 + 4),
        "written_bytes": 50 * 8,
        "flops": 800 * FLOPS["taken"] + 400 * FLOPS["tested lane"] + 100 * FLOPS["hit"],
    }
    taken, fragments = 700 * FLOPS["taken"], 80 * FLOPS["fragment"]
    assert vars(work["attributes"]) == {
        "read_bytes": 900 * 4 + 700 * (64 + 32 + 8) + 50 * 4,
        "written_bytes": 50 * 36,
        "flops": taken + 500 * FLOPS["prefiltered lane"] + fragments,
    }
    assert vars(work["shade"]) == {
        "read_bytes": 50 * 36,
        "written_bytes": 50 * 16,
        "flops": 40 * (FLOPS["pixel"] + FLOPS["ambient"] + 3 * FLOPS["light"]),
    }
    plain = work_of(result_of(replace(settings, shader="albedo", prefilter="none")))
    assert plain["shade"].flops == 40 * FLOPS["pixel"]
    assert plain["attributes"].flops == taken + 500 * FLOPS["filtered lane"] + fragments
    kept = work_of(result_of(replace(settings, facing="keep")))
    assert kept["bin"].flops == 1000 * FLOPS["splat"] + 600 * FLOPS["listed"]


def test_a_pass_is_held_against_the_slower_of_memory_and_arithmetic():
    result = result_of(project=10.0)
    slow_memory = Limits(read=100.0, write=1000.0, copy=1.0, flops={"single": 1e9})
    limit = limits_of(result, slow_memory)["project"]
    assert limit.bound == "memory"
    assert limit.limit_seconds == pytest.approx(46800 / 100 + 100800 / 1000)
    assert limit.share_of_limit == pytest.approx(limit.limit_seconds / 10)
    slow_arithmetic = Limits(read=1e9, write=1e9, copy=1.0, flops={"single": 1e3})
    limits = limits_of(result, slow_arithmetic)
    assert limits["project"].bound == "arithmetic"
    assert limits["visibility"].lanes_used == pytest.approx(100 / 400)
    assert limits["attributes"].lanes_used == pytest.approx(80 / 500)
    assert limits["bin"].lanes_used is None


@pytest.mark.parametrize("mapping", ["tile", "pixel"])
@pytest.mark.parametrize("precision", ["single", "double"])
def test_roofline_kernels_touch_every_number(mapping, precision):
    device = splatcl.Renderer(mapping=mapping).device
    if precision == "double" and device.info.supports["double"] != "yes":
        pytest.skip("no double precision")
    one = Roofline(device, SMALL, precision)
    real = np.dtype("f4" if precision == "single" else "f8")
    count = one.num_bytes // real.itemsize
    written = device.read(one._numbers, (count,), real)
    items, each = np.unique(written, return_counts=True)
    assert len(items) == one._num_items and (each == count // len(items)).all()
    np.testing.assert_array_equal(device.read(one._copy, (count,), real), written)
    numbers = (np.arange(count) % 1021).astype(real)
    device.write(one._numbers, numbers)
    one.read()
    sums = device.read(one._sums, (one._num_items, one._lanes), real)
    assert sums.sum(dtype=np.float64) == numbers.sum(dtype=np.float64)
    if mapping == "pixel":
        return  # a GPU's arithmetic takes a CPU seconds
    assert one.arithmetic() > 0
    sums = device.read(one._sums, (one._num_items, one._lanes), real)
    np.testing.assert_allclose(sums, roofline.CHAINS, rtol=1e-3)  # a = 0.999 a + 0.001 tends to 1


# --- the command


@pytest.fixture
def run(monkeypatch, tmp_path, capsys, quick_limits):
    """Run ``splatcl bench`` in an empty folder; return status, stdout, lines of stderr."""
    monkeypatch.chdir(tmp_path)

    def run_bench(command):
        status = main(["bench", *command.split()])
        captured = capsys.readouterr()
        return status, captured.out, captured.err.splitlines()

    return run_bench


def test_everything_is_measured_printed_and_written(run, tmp_path):
    status, out, err = run("--sizes 200,300 --frames 1 --plot plot.png --output all.json")
    assert (status, err) == (0, [])
    content = json.loads((tmp_path / "all.json").read_text())
    assert {"machine", "device", "versions", "limits", "rows", "skipped"} == set(content)
    assert content["versions"]["splatcl"] == splatcl.__version__ and content["device"]["name"]
    assert content["limits"]["read"] > 0 and content["limits"]["flops"]["single"] > 0
    names = [row["name"] for row in content["rows"]] + [row["name"] for row in content["skipped"]]
    assert sorted(names) == sorted(row.name for row in rows((200, 300)))
    for row in content["rows"]:
        assert len(row["frame"]["samples"]) == 1 and set(row["passes"]) == set(row["limits"]) == set(PASSES)
        assert row["splats_per_second"] == pytest.approx(row["num_splats"] / row["frame"]["median"])
        assert row["counts"]["num_splats"] == row["num_splats"]
    scan = next(row for row in content["rows"] if row["model"] == "scan")
    assert (scan["settings"]["facing"], scan["facing"]) == ("cull", "flip")
    for words in ("Table 1", "Passes, ms", "shuffled", "Limits: read", "Roofline of sphere 300", "wrote all.json"):
        assert words in out
    image = imageio.imread(tmp_path / "plot.png")
    assert image.ndim == 3 and image.std() > 5


def test_what_was_asked_for_is_measured(run, tmp_path):
    assert run("--sizes 200 --frames 1 --only shuffled")[0] == 0
    content = json.loads((tmp_path / "bench.json").read_text())
    assert [row["factor"] for row in content["rows"]] == ["", "shuffled"]
    assert [row["order"] for row in content["rows"]] == ["coherent", "shuffled"]


def test_without_a_scan_its_row_is_skipped(run, monkeypatch, tmp_path):
    monkeypatch.setattr(scenes, "BUNDLED_SCAN", tmp_path / "none.pts")
    status, out, _ = run("--sizes 200 --frames 1 --only scan")
    assert status == 0 and "skipped sphere" not in out
    assert "skipped scan 200" in out and "give --model FILE" in out


@pytest.mark.parametrize(
    ("command", "words"),
    [
        ("--sizes many", "--sizes 'many'"),
        ("--sizes 0", "--sizes '0'"),
        ("--sizes 101M", "up to 100M"),
        ("--frames 0", "--frames 0"),
        ("--quick --sizes 1k", "--quick and --sizes"),
        ("--only nothing", "there are cull"),
        ("--against llvmpipe --plot a.png", "--against and --plot"),
        ("--against mesa", "llvmpipe"),
        ("--plot a.jpg", "a.jpg does not end in .png"),
        ("--plot none/a.png", "none/a.png: cannot write"),
        ("--output none/a.json", "none/a.json: cannot write"),
        ("--device nowhere", "nowhere"),
        ("--sizes 200 --model none.ply", "none.ply"),
    ],
)
def test_mistakes_get_one_line(run, tmp_path, command, words):
    status, _, err = run(command)
    assert status == 2 and len(err) == 1 and words in err[0]
    assert not list(tmp_path.iterdir())


def test_a_missing_matplotlib_is_named_with_the_remedy(run, monkeypatch):
    monkeypatch.setattr(plot, "find_spec", lambda name: None)
    status, _, err = run("--plot a.png")
    assert status == 2 and len(err) == 1 and "pip install 'splatcl[bench]'" in err[0]


@pytest.mark.parametrize(
    ("name", "value", "reason"),
    [("free_memory", lambda: 1e6, "GiB of memory"), ("MAX_FRAME_SECONDS", 0.0, "one frame took")],
)
def test_what_does_not_fit_is_skipped_with_a_reason(renderer, monkeypatch, name, value, reason):
    monkeypatch.setattr(measure, name, value)
    results, skipped = measure.measure(renderer, [Row(200, BASE)], 1, None, lambda line: None)
    assert not results and isinstance(skipped[0], Skipped) and reason in skipped[0].reason


@pytest.mark.parametrize("error", [cl.MemoryError("no memory"), MemoryError()])
def test_what_the_device_refuses_is_skipped(renderer, monkeypatch, error):
    def refuse(self, watch=None):
        raise error

    monkeypatch.setattr(FramePasses, "run", refuse)
    results, (skipped,) = measure.measure(renderer, [Row(200, BASE)], 1, None, lambda line: None)
    assert not results and "memory" in skipped.reason


# --- against another renderer


def test_ratio_against_a_stub(run, stub_backend, tmp_path):
    status, out, err = run("--sizes 300 --frames 2 --against llvmpipe --output a.json")
    assert (status, err) == (0, []) and "OpenGL on stub" in out
    content = json.loads((tmp_path / "a.json").read_text())["against"]
    assert [(one["num_splats"], one["facing"]) for one in content] == [(300, "cull"), (300, "keep")]
    for one in content:
        for name, ratio in (("theirs", "ratio"), ("theirs_sorted", "ratio_sorted")):
            assert one[ratio] == pytest.approx(one[name]["median"] / one["ours"]["median"])
            assert len(one["ours"]["samples"]) == len(one[name]["samples"]) == 2
        assert 0 < one["difference"] < 1 and 0 < one["coverage_differs"] < 1


def test_a_missing_backend_is_named_with_the_remedy(run, stub_backend):
    stub_backend.write_text("import no_such_module")
    status, _, err = run("--against llvmpipe")
    assert status == 2 and len(err) == 1 and "pip install 'splatcl[gl]'" in err[0]
    stub_backend.unlink()
    with pytest.raises(SplatclError, match="run it from a checkout"):
        against.load_backend(stub_backend)


# --- the guard


def test_guard_measures_passes_by_a_calibration(renderer, stub_backend):
    ratios = guard.measure_ratios(renderer, (200,), 1)
    scenes_passes = [f"200 {facing} {name}" for facing in ("cull", "keep") for name in ("frame", *PASSES)]
    assert list(ratios) == [*scenes_passes, "200 cull frame by llvmpipe"]
    assert all(ratio > 0 for ratio in ratios.values())


@pytest.mark.parametrize(("now", "status"), [(1.4, 0), (0.2, 0), (1.6, 1)])
def test_guard_fails_only_where_much_is_lost(monkeypatch, capsys, tmp_path, now, status):
    path = tmp_path / "ratios.json"
    monkeypatch.setattr(guard, "measure_ratios", lambda renderer: {"137k cull bin": 1.0, "same": 1.0})
    assert guard.main([str(path), "--update"]) == 0
    monkeypatch.setattr(guard, "measure_ratios", lambda renderer: {"137k cull bin": now, "same": 1.0})
    capsys.readouterr()
    assert guard.main([str(path)]) == status
    captured = capsys.readouterr()
    assert f"{now:.3f}   1.000" in captured.out
    assert captured.err.splitlines() == ["bench-check: over 1.5 times the stored ratio: 137k cull bin"] * status


def test_guard_reports_what_only_one_side_has():
    lines, slower = guard.compare({"new": 1.0}, {"old": 1.0})
    assert not slower and len(lines) == 3 and lines[1].split()[0] == "-"


@pytest.mark.parametrize("text", [None, "{", "[]", '{"ratios": {"a": "b"}}'])
def test_guard_says_how_to_make_its_file(capsys, tmp_path, text):
    path = tmp_path / "ratios.json"
    if text is not None:
        path.write_text(text)
    assert guard.main([str(path)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert str(path) in line and "make bench-check-update" in line
    with pytest.raises(FileError):
        guard.read_stored(path)


def test_stored_ratios_are_those_of_the_guard():
    stored = guard.read_stored(ROOT / "docs" / "bench_ratios.json")["ratios"]
    names = [f"{size_name(s)} {f} {p}" for s in guard.SIZES for f in ("cull", "keep") for p in ("frame", *PASSES)]
    assert set(names) <= set(stored)
