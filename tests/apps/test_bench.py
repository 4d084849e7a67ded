"""``splatcl bench``: its output and files, and the rows that it skips or refuses. No test reads the size of a time."""

from __future__ import annotations

import json
from functools import partial

import imageio.v3 as imageio
import pyopencl as cl
import pytest

import splatcl
from splatcl.apps import sample_scenes
from splatcl.apps.bench import against, matrix, measure, plot, roofline
from splatcl.apps.bench.matrix import BASE, Row, rows
from splatcl.apps.bench.measure import Skipped
from splatcl.apps.bench.passes import PASSES, FramePasses
from splatcl.apps.bench.roofline import measure_limits
from splatcl.cli import main
from splatcl.errors import SplatclError

SMALL = 1 << 20
SOME_FACTORS = ("shuffled", "1920x1080", "no pre-filter", "3 lights", "double", "scan")
"""A few factors, as most compile programs of their own."""


@pytest.fixture
def quick_limits(monkeypatch):
    """Measure the machine's limits on a buffer that fits caches."""
    monkeypatch.setattr(roofline, "REPETITIONS", 1)
    monkeypatch.setattr(roofline, "measure_limits", partial(measure_limits, num_bytes=SMALL))


@pytest.fixture
def run(monkeypatch, tmp_path, capsys, quick_limits):
    """Run ``splatcl bench`` in an empty folder; return status, stdout, lines of stderr."""
    monkeypatch.chdir(tmp_path)

    def run_bench(command):
        status = main(["bench", *command.split()])
        captured = capsys.readouterr()
        return status, captured.out, captured.err.splitlines()

    return run_bench


@pytest.mark.parametrize("every", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_everything_is_measured_printed_and_written(run, tmp_path, monkeypatch, every):
    if not every:
        some = [row for row in matrix.FACTORS if row.factor in SOME_FACTORS]
        monkeypatch.setattr(matrix, "FACTORS", some)
        assert len(some) == len(SOME_FACTORS)
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
    monkeypatch.setattr(sample_scenes, "BUNDLED_SCAN", tmp_path / "none.pts")
    status, out, _ = run("--sizes 200 --frames 1 --only scan")
    assert status == 0 and "skipped sphere" not in out
    assert "skipped scan 200" in out and "give --model FILE" in out


@pytest.mark.parametrize(
    ("command", "words"),
    [
        ("--sizes many", "--sizes 'many'"),
        ("--sizes 0", "--sizes '0'"),
        ("--sizes 101M", "up to 100M"),
        ("--frames 0", "--frames 0 must be between 1 and 1000"),
        ("--quick --sizes 1k", "--quick and --sizes cannot be combined; remove one"),
        ("--only nothing", "there are cull"),
        ("--against llvmpipe --plot a.png", "--against and --plot cannot be combined; remove one"),
        ("--against mesa", "llvmpipe"),
        ("--plot a.jpg", "a.jpg must end in .png"),
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
