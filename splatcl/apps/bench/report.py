"""Print results as tables and write them as JSON."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from splatcl.apps.bench.against import Comparison
from splatcl.apps.bench.matrix import base_of, size_name
from splatcl.apps.bench.measure import Result, Skipped
from splatcl.apps.bench.passes import PASSES
from splatcl.apps.bench.roofline import Limits
from splatcl.apps.bench.work import limits_of
from splatcl.apps.timing import Spread
from splatcl.util.atomic import atomic_path

WIDTH = 156
"""Columns if the output is not a terminal."""


def print_tables(results: Sequence[Result], skipped: Sequence[Skipped], limits: Limits) -> None:
    """Print Table 1, the passes, the ratios, the roofline and the skipped configurations."""
    base = [result for result in results if not result.row.factor]
    _print_table("Table 1 of [BHZK05], sphere, 512x512, Phong", TABLE_1, map(_table_1_row, base))
    _print_table(
        "Passes, ms (a wait after each, in each band: the sum exceeds the frame)", PASS_COLUMNS, map(_pass_row, results)
    )
    _print_table("One factor varied, compared with cull of the same size", RATIO_COLUMNS, _ratio_rows(results))
    single, double = (limits.flops.get(precision, 0.0) / 1e9 for precision in ("single", "double"))
    print(
        f"\nLimits: read {limits.read / 1e9:.1f} GB/s, write {limits.write / 1e9:.1f} GB/s, copy "
        f"{limits.copy / 1e9:.1f} GB/s, arithmetic {single:.0f} GFLOP/s" + (f", double {double:.0f}" if double else "")
    )
    largest = max((result.row.num_splats for result in results), default=0)
    for result in results:
        if result.row.num_splats == largest and result in (base or results):
            _print_table(f"Roofline of {result.row.name}", ROOFLINE_COLUMNS, _roofline_rows(result, limits))
    for one in skipped:
        print(f"skipped {one.row.name}: {one.reason}")


TABLE_1 = (
    "facing", "splats", "Msplats/s", "frames/s", "median ms", "quartiles ms", "least ms", "fragments/pixel no filter",
    "with pre-filter",
)  # fmt: skip
PASS_COLUMNS = ("configuration", "splats", *PASSES, "sum", "frame", "shading")
RATIO_COLUMNS = ("configuration", "splats", "median ms", "quartiles ms", "time / base", "speed / base")
ROOFLINE_COLUMNS = (
    "pass", "read MB", "written MB", "MFLOP", "lanes used", "limit ms", "set by", "measured ms", "of its limit",
)  # fmt: skip
COMPARISON_COLUMNS = (
    "facing", "splats", "splatcl ms", "quartiles ms", "llvmpipe ms", "quartiles ms", "times as fast", "sorted ms",
    "times as fast", "color differs", "coverage differs",
)  # fmt: skip


def _table_1_row(result: Result) -> tuple[str, ...]:
    fragments, frame = result.fragments, result.frame
    return (
        result.row.settings.facing,
        size_name(result.row.num_splats),
        f"{result.splats_per_second / 1e6:.1f}",
        f"{1 / frame.median:.1f}",
        _ms(frame.median),
        _quartiles(frame),
        _ms(frame.minimum),
        f"{fragments.without_prefilter.per_pixel:.2f}",
        f"{fragments.with_prefilter.per_pixel:.2f}",
    )


def _pass_row(result: Result) -> tuple[str, ...]:
    medians = {name: spread.median for name, spread in result.passes.items()}
    total = sum(medians.values())
    passes = (f"{_ms(medians[name])} {medians[name] / total:4.0%}" for name in PASSES)
    size = size_name(result.row.num_splats)
    return result.row.label, size, *passes, _ms(total), _ms(result.frame.median), f"{result.shading_share:.1%}"


def _ratio_rows(results: Sequence[Result]) -> Iterable[tuple[str, ...]]:
    medians = {result.row: result.frame.median for result in results}
    for result in results:
        base, median = medians.get(base_of(result.row)), result.frame.median
        if base and base_of(result.row) != result.row:
            label = result.row.label
            if result.facing != result.row.settings.facing:
                label += f" ({result.facing})"
            ratios = f"{median / base:.2f}", f"{base / median:.2f}"
            yield label, size_name(result.row.num_splats), _ms(median), _quartiles(result.frame), *ratios


def _roofline_rows(result: Result, limits: Limits) -> Iterable[tuple[str, ...]]:
    for name, limit in limits_of(result, limits).items():
        work = limit.work
        yield (
            name,
            f"{work.read_bytes / 1e6:.1f}",
            f"{work.written_bytes / 1e6:.1f}",
            f"{work.flops / 1e6:.1f}",
            "" if limit.lanes_used is None else f"{limit.lanes_used:.0%}",
            _ms(limit.limit_seconds),
            limit.bound,
            _ms(result.passes[name].median),
            f"{limit.share_of_limit:.0%}",
        )


def print_comparisons(comparisons: Sequence[Comparison]) -> None:
    """Print the comparisons of splatcl with another renderer."""
    name = comparisons[0].renderer_name
    _print_table(
        f"splatcl against OpenGL on {name}, sphere, 512x512", COMPARISON_COLUMNS, map(_comparison_row, comparisons)
    )


def _comparison_row(one: Comparison) -> tuple[str, ...]:
    times = (cell for spread in (one.ours, one.theirs) for cell in (_ms(spread.median), _quartiles(spread)))
    differences = f"{one.difference:.5f}", f"{one.coverage_differs:.3%}"
    ratios = f"{one.ratio:.1f}", _ms(one.theirs_sorted.median), f"{one.ratio_sorted:.1f}"
    return one.facing, size_name(one.num_splats), *times, *ratios, *differences


def _print_table(title: str, columns: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    from rich import box
    from rich.console import Console
    from rich.table import Table

    table = Table(title=title, box=box.SIMPLE, title_justify="left")
    for place, column in enumerate(columns):
        table.add_column(column, justify="right" if place else "left")
    for row in rows:
        table.add_row(*row)
    if table.rows:
        Console(width=None if sys.stdout.isatty() else WIDTH, markup=False).print(table)


def _ms(seconds: float) -> str:
    return f"{seconds * 1e3:.2f}"


def _quartiles(spread: Spread) -> str:
    return "-".join(map(_ms, spread.quartiles))


def results_as_json(results: Sequence[Result], skipped: Sequence[Skipped], limits: Limits) -> dict[str, Any]:
    """Return all measurements as JSON's types."""
    return {
        "limits": vars(limits),
        "rows": [
            result.as_json() | {"limits": {n: limit.as_json() for n, limit in limits_of(result, limits).items()}}
            for result in results
        ],
        "skipped": [{"name": one.row.name, "reason": one.reason} for one in skipped],
    }


def save_json(path: Path, content: dict[str, Any]) -> None:
    """Write `content` whole or not at all."""
    with atomic_path(path) as temporary:
        temporary.write_text(json.dumps(content, indent=1) + "\n")
