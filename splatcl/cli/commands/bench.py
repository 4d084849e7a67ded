"""``splatcl bench``: the speed of rendering on this machine, and its limits."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from splatcl.cli.options.device import DeviceOption
from splatcl.errors import SettingsError
from splatcl.util.progress import stage

if TYPE_CHECKING:
    from splatcl.apps.bench.matrix import Row
    from splatcl.renderer import Renderer
    from splatcl.scene.splats import Splats

MAX_FRAMES = 1000


def bench(
    *,
    output: Path = Path("bench.json"),
    plot: Path | None = None,
    sizes: str | None = None,
    only: str | None = None,
    frames: int = 11,
    quick: bool = False,
    model: Path | None = None,
    against: Literal["llvmpipe"] | None = None,
    device: DeviceOption = None,
) -> None:
    """Time each pass and whole frames over a matrix of scenes and settings.

    Parameters
    ----------
    output : path
        JSON file to write: every sample, the machine and the device.
    plot : path
        .png file to write: splats per second, and time, by number of splats.
    sizes : str
        Numbers of splats, such as 137k,1.1M [default: those of [BHZK05], Table 1, up to 14M].
    only : str
        Words in the names of the configurations to measure, such as shuffled, 1920x1080 or keep,scan.
    frames : int
        Samples of each configuration, 1 to 1000; slow configurations take fewer.
    quick : bool
        Measure small sizes alone, under a minute.
    model : path
        Scan whose discs are divided until the number of splats is reached [default: the bunny of the checkout].
    against : str
        Instead, time the OpenGL passes of examples/backend_gl and ours in turn.
    """
    import splatcl
    from splatcl.apps.bench import machine
    from splatcl.apps.bench.report import save_json
    from splatcl.util.atomic import check_writable

    if not 1 <= frames <= MAX_FRAMES:
        raise SettingsError(f"--frames {frames} must be between 1 and {MAX_FRAMES}")
    for name, value in (("--only", only), ("--plot", plot), ("--model", model)):
        if against and value:
            raise SettingsError(f"--against and {name} cannot be combined; remove one")
    numbers = _numbers(sizes, quick)
    rows = _rows(numbers, only)
    check_writable(output)
    if plot:
        from splatcl.apps.bench.plot import check_plot

        check_plot(plot)
    renderer = splatcl.Renderer(device=device)
    facts = machine.facts(renderer.device)
    print(f"{facts['device']['version']}, {facts['device']['name']}, {facts['machine']['cpus']} CPUs")
    content = _against(renderer, numbers, frames) if against else _matrix(renderer, rows, frames, model, plot)
    save_json(output, facts | content)
    print(f"wrote {output}")


def _numbers(sizes: str | None, quick: bool) -> tuple[int, ...] | None:
    """Return the numbers of splats to measure, None for the default."""
    from splatcl.apps.bench import matrix

    if quick and sizes:
        raise SettingsError("--quick and --sizes cannot be combined; remove one")
    if quick:
        return matrix.QUICK_SIZES
    return None if sizes is None else matrix.parse_sizes(sizes)


def _rows(numbers: tuple[int, ...] | None, only: str | None) -> list[Row]:
    from splatcl.apps.bench import matrix

    rows = matrix.rows(numbers or matrix.SIZES)
    return rows if only is None else matrix.only(rows, only)


def _matrix(renderer: Renderer, rows: list[Row], frames: int, model: Path | None, plot: Path | None) -> dict[str, Any]:
    from splatcl.apps.bench.measure import measure
    from splatcl.apps.bench.plot import save_plot
    from splatcl.apps.bench.report import print_tables, results_as_json
    from splatcl.apps.bench.roofline import measure_limits

    scan = _scan(model) if any(row.model == "scan" for row in rows) else None
    with stage("Measuring the machine's limits"):
        limits = measure_limits(renderer.device)
    results, skipped = measure(renderer, rows, frames, scan, print)
    print_tables(results, skipped, limits)
    if plot and results:
        save_plot(plot, results)
        print(f"wrote {plot}")
    return results_as_json(results, skipped, limits)


def _against(renderer: Renderer, sizes: tuple[int, ...] | None, frames: int) -> dict[str, Any]:
    from splatcl.apps.bench import against
    from splatcl.apps.bench.report import print_comparisons

    backend = against.load_backend(against.BACKEND)
    comparisons = list(against.compare(renderer, backend, sizes or against.SIZES, frames))
    print_comparisons(comparisons)
    return {"against": [one.as_json() for one in comparisons]}


def _scan(model: Path | None) -> Splats | None:
    from splatcl.apps.sample_scenes import bundled_scan
    from splatcl.io.read import read

    path = model or bundled_scan()
    if path is None:
        return None
    with stage(f"Reading {path.name}"):
        return read(path)
