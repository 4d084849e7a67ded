"""Plot splats a second and the growth of the frame time, a line for each configuration, as PNG."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

from splatcl.apps.bench.matrix import size_name
from splatcl.apps.bench.measure import Result
from splatcl.errors import SplatclError
from splatcl.util.atomic import atomic_path, check_writable

PAPER = 22.6e6
"""Splats a second of a GeForce 6800 Ultra ([BHZK05] Table 1)."""

LINEAR = 2e-5
"""Slope of the reference line, ms for each splat and fragment."""


def check_plot(path: Path) -> None:
    """Raise an error if a plot cannot be drawn or written at `path`.

    Raises
    ------
    SplatclError
        `path` is no PNG or cannot be written, or matplotlib is missing.
    """
    if path.suffix.lower() != ".png":
        raise SplatclError(f"--plot {path} must end in .png")
    if find_spec("matplotlib") is None:
        raise SplatclError("--plot cannot draw without matplotlib; pip install 'splatcl[bench]'")
    check_writable(path)


def _work(result: Result) -> int:
    return result.row.num_splats + result.fragments.drawn.fragments


def save_plot(path: Path, results: Sequence[Result]) -> None:
    """Plot the results and write the plot to `path`."""
    from matplotlib import colormaps
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(14, 6), layout="constrained")
    FigureCanvasAgg(figure)
    rate, growth = figure.subplots(1, 2, subplot_kw={"xscale": "log", "yscale": "log"})
    rate.set(xlabel="splats", ylabel="splats a second")
    growth.set(xlabel="splats + accumulated fragments", ylabel="ms a frame")
    lines = defaultdict(list)
    for result in results:
        lines[result.row.label].append(result)
    for axes in (rate, growth):
        axes.set_prop_cycle(color=[colormaps["tab20"](color) for color in range(20)])
        axes.grid(alpha=0.3)
    for label, row in lines.items():
        rate.plot([one.row.num_splats for one in row], [one.splats_per_second for one in row], "o-", label=label)
        growth.plot([_work(one) for one in row], [one.frame.median * 1e3 for one in row], "o-")
    rate.axhline(PAPER, linestyle="--", color="gray", label="GeForce 6800 Ultra [BHZK05]")
    sizes = sorted({result.row.num_splats for result in results})
    rate.set_xticks(sizes, list(map(size_name, sizes)))
    rate.minorticks_off()
    ends = [min(map(_work, results)), max(map(_work, results))]
    growth.plot(ends, [LINEAR * end for end in ends], "--", color="gray", label=f"{LINEAR * 1e6:g} ns each")
    figure.legend(loc="outside right center")
    with atomic_path(path) as temporary:
        figure.savefig(temporary, dpi=120)
