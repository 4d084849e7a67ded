"""Guard against slower passes: compare times, in a calibration kernel's units, with stored ones (docs/speed/bench.md).

``python -m splatcl.apps.bench.guard FILE`` compares with the ratios stored in FILE; ``--update`` rewrites them. Exit
status: 0 no ratio is much larger than its stored value, 1 one is, 2 wrong arguments.
"""

from __future__ import annotations

import json
import sys
from argparse import ArgumentParser
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from splatcl.apps.bench import against, machine
from splatcl.apps.bench.matrix import BASE, Row, size_name
from splatcl.apps.bench.measure import Job
from splatcl.apps.bench.report import save_json
from splatcl.apps.bench.roofline import SMALL_BYTES, Roofline
from splatcl.apps.sample_scenes import fibonacci_sphere, frame_camera
from splatcl.apps.timing import Seconds, Spread, seconds_of, turn_by_turn
from splatcl.errors import FileError, SplatclError
from splatcl.opencl.session import UploadedSplats
from splatcl.renderer import Renderer
from splatcl.util.progress import stage
from splatcl.util.table import text_table

BOUND = 1.5
"""Largest quotient of a ratio and its stored value; a larger one is a regression. Load changes ratios by a fifth."""
SIZES = (137_000, 655_000)
"""Numbers of splats."""
ROUNDS = 25
"""Number of samples of each time."""
MAX_SECONDS = 60.0
"""Time after which no further round starts, seconds."""

Ratios = dict[str, float]
"""Time / time of the calibration kernel, by name."""


def measure_ratios(renderer: Renderer, sizes: Sequence[int] = SIZES, rounds: int = ROUNDS) -> Ratios:
    """Measure times in units of the calibration's, and the first scene's frame in units of llvmpipe's if it runs."""
    calibration = Roofline(renderer.device, SMALL_BYTES)
    jobs: list[Callable[[], Seconds]] = [lambda: {"arithmetic": calibration.arithmetic()}]
    scenes, spheres = [], [renderer.upload(fibonacci_sphere(size)) for size in sizes]
    for uploaded in spheres:
        for settings in (BASE, replace(BASE, facing="keep")):
            row = Row(len(uploaded.splats), settings)
            scenes.append(f"{size_name(row.num_splats)} {row.label}")
            jobs.append(Job(renderer, uploaded, row).times)
    jobs += _llvmpipe_jobs(spheres[0])
    with stage("Timing", total=rounds * len(jobs)) as advance:
        unit, *times = turn_by_turn(jobs, rounds, MAX_SECONDS, advance)
    ratios = {
        f"{scene} {name}": _ratio(spread, unit["arithmetic"])
        for scene, spreads in zip(scenes, times, strict=False)
        for name, spread in spreads.items()
    }
    if len(times) > len(scenes):
        ratios[f"{scenes[0]} frame by llvmpipe"] = _ratio(times[0]["frame"], times[-1]["llvmpipe"])
    return ratios


def _llvmpipe_jobs(uploaded: UploadedSplats) -> Iterator[Callable[[], Seconds]]:
    try:
        backend = against.load_backend(against.BACKEND)(uploaded.splats, sort=False)
    except SplatclError as error:
        print(f"skipped llvmpipe: {error}")
        return
    camera = frame_camera(uploaded.splats, 512, 512)
    backend.draw(camera, BASE)
    yield lambda: {"llvmpipe": seconds_of(lambda: backend.draw(camera, BASE))}


def _ratio(spread: Spread, unit: Spread) -> float:
    """Return the median over the rounds of the ratio in each round."""
    return float(np.median(np.array(spread.samples) / unit.samples))


def compare(now: Ratios, stored: Ratios) -> tuple[list[str], list[str]]:
    """Return the lines of a table, and the names of the ratios over `BOUND` times their stored values."""
    rows, slower = [], []
    for name in dict.fromkeys((*stored, *now)):
        old, new = stored.get(name), now.get(name)
        change = new / old if old and new else None
        cells = ("-" if value is None else f"{value:.3f}" for value in (new, old, change))
        verdict = "SLOWER" if change and change > BOUND else ""
        slower += [name] if verdict else []
        rows.append((*cells, verdict, name))
    return list(text_table(("now", "stored", "change", "", "time / calibration"), rows)), slower


def read_stored(path: Path) -> dict[str, Any]:
    """Read the file of stored ratios.

    Raises
    ------
    FileError
        The file is missing or damaged.
    """
    remedy = "write it with make bench-check-update"
    try:
        stored = json.loads(path.read_text())
        ratios = {str(name): float(value) for name, value in stored["ratios"].items()}
    except OSError as error:
        raise FileError(f"{path}: cannot read: {error.strerror}; {remedy}") from error
    except (ValueError, KeyError, TypeError, AttributeError):
        raise FileError(f"{path}: has no valid ratios; {remedy}") from None
    return stored | {"ratios": ratios}


def check(path: Path, update: bool, renderer: Renderer) -> int:
    """Measure the ratios and compare them with the file, or rewrite it; return the exit status."""
    stored = None if update else read_stored(path)
    facts = machine.facts(renderer.device)
    now = measure_ratios(renderer)
    if stored is None:
        save_json(path, facts | {"ratios": {name: round(ratio, 4) for name, ratio in now.items()}})
        print(f"wrote {path}: {len(now)} ratios")
        return 0
    if stored.get("machine", {}).get("cpu") != facts["machine"]["cpu"]:
        print("note: the stored ratios are those of another processor; they may differ here")
    lines, slower = compare(now, stored["ratios"])
    print("\n".join(lines))
    if slower:
        print(f"bench-check: over {BOUND} times the stored ratio: {', '.join(slower)}", file=sys.stderr)
    return int(bool(slower))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the guard and return the exit status."""
    parser = ArgumentParser(prog="python -m splatcl.apps.bench.guard", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("file", type=Path, help="stored ratios")
    parser.add_argument("--update", action="store_true", help="measure and rewrite the file")
    given = parser.parse_args(arguments)
    try:
        return check(given.file, given.update, Renderer())
    except SplatclError as error:
        print(f"bench-check: error: {error}", file=sys.stderr)
        return 2


if __name__ == "__main__":
    sys.exit(main())
