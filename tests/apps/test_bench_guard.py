"""The benchmark's guard against slowdowns, and its stored ratios."""

from __future__ import annotations

import pytest
from helpers.paths import ROOT

from splatcl.apps.bench import guard
from splatcl.apps.bench.matrix import size_name
from splatcl.apps.bench.passes import PASSES
from splatcl.errors import FileError


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
    stored = guard.read_stored(ROOT / "docs" / "speed" / "bench_ratios.json")["ratios"]
    names = [f"{size_name(s)} {f} {p}" for s in guard.SIZES for f in ("cull", "keep") for p in ("frame", *PASSES)]
    assert set(names) <= set(stored)
