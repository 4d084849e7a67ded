"""Splats a second against the number of splats, a line for each configuration, as a PNG."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

from splatcl.bench.matrix import size_name
from splatcl.bench.measure import Result
from splatcl.errors import SplatclError
from splatcl.io.atomic import atomic_path, check_writable

PAPER = 22.6e6
"""Splats a second on a GeForce 6800 Ultra ([BHZK05] Table 1)."""


def check_plot(path: Path) -> None:
    """Raise an error now if a plot could not be drawn or written.

    Raises
    ------
    SplatclError
        It is not a PNG, cannot be written, or matplotlib is missing.
    """
    if path.suffix.lower() != ".png":
        raise SplatclError(f"--plot {path} does not end in .png")
    if find_spec("matplotlib") is None:
        raise SplatclError("--plot needs matplotlib: pip install 'splatcl[bench]'")
    check_writable(path)


def save_plot(path: Path, results: Sequence[Result]) -> None:
    """Draw the results and write them to `path`."""
    from matplotlib import colormaps
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    lines = defaultdict(list)
    for result in results:
        lines[result.row.label].append((result.row.num_splats, result.splats_per_second))
    figure = Figure(figsize=(9, 6), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot(xscale="log", yscale="log", xlabel="splats", ylabel="splats a second")
    axes.set_prop_cycle(color=[colormaps["tab20"](color) for color in range(20)])
    for label, points in lines.items():
        axes.plot(*zip(*points, strict=True), marker="o", label=label)
    axes.axhline(PAPER, linestyle="--", color="gray", label="GeForce 6800 Ultra [BHZK05]")
    sizes = sorted({result.row.num_splats for result in results})
    axes.set_xticks(sizes, list(map(size_name, sizes)))
    axes.minorticks_off()
    axes.grid(alpha=0.3)
    axes.legend(loc="center left", bbox_to_anchor=(1, 0.5))
    with atomic_path(path) as temporary:
        figure.savefig(temporary, dpi=120)
