"""Write the rows of all claims to the terminal, as JSON, and to a page of the documentation."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import get_args

from splatcl.apps.paper.claims import Row, Status, claims, counts
from splatcl.apps.paper.report import WIDTH, make_folder, markdown_table, write_text

TITLES = {"BHZK05": "[BHZK05]", "slides": "Slides of [BHZK05]", "ZRB04": "[ZRB04]"}
INTRODUCTION = """\
# Every claim of the papers

`splatcl paper list` prints every claim, definition, parameter, number, figure and table of [BHZK05], its slides and
[ZRB04], in our words. It wrote this page.

```console
$ splatcl paper list                                      # all rows, and their number by paper and status
$ splatcl paper list --paper ZRB04 --status "not rerun"   # one paper, one status
$ splatcl paper list --json                               # for programs
$ splatcl paper list --docs docs                          # this page
```

- **experiment**: `splatcl paper` measures the row; [paper.md](paper.md) has the numbers and says what holds.
- **definition**: splatcl does the same by construction, or the row says how it differs.
- **not rerun**: nothing decides the row. The reason stands beside it, or the check that would decide it.
- Bounds were fixed on reading the papers, before any run. Exceptions: an "existing" bound is that of paper.md, and a
  "seen" number was known before.
- Slides count from the title slide, 1. Rows refer to each other by the names under their sections.
- [specification.md](../specification.md) lists the papers.
"""
COLUMNS = ("section", "the paper says", "here", "status", "why")


def print_rows(rows: Sequence[Row]) -> None:
    """Print the rows as a table, and their counts."""
    from rich import box
    from rich.console import Console
    from rich.table import Table

    console = Console(width=None if sys.stdout.isatty() else WIDTH, markup=False, highlight=False)
    table = Table(box=box.SIMPLE, show_lines=True)
    for column, ratio in zip(("paper", *COLUMNS), (3, 5, 11, 8, 5, 12), strict=True):
        table.add_column(column, ratio=ratio, overflow="fold")
    for row in rows:
        table.add_row(row.paper, f"{row.section}\n{row.id}", row.says, row.here, row.verdict, row.reason)
    console.print(table)
    totals = Table(box=box.SIMPLE)
    for place, column in enumerate(_totals(rows)[0]):
        totals.add_column(column, justify="right" if place else "left")
    for line in _totals(rows)[1:]:
        totals.add_row(*line)
    console.print(totals)


def as_json(rows: Sequence[Row]) -> str:
    """Return the rows, with the reason of each, and their counts as JSON."""
    listed = [asdict(row) | {"reason": row.reason} for row in rows]
    return json.dumps({"rows": listed, "counts": counts(rows)}, indent=1, ensure_ascii=False)


def page() -> str:
    """Return Markdown: the counts, and a table of the rows of each paper."""
    rows = claims()
    header, *lines = _totals(rows)
    text = [INTRODUCTION, *markdown_table(header, lines)]
    for paper, title in TITLES.items():
        cells = [
            (f"{row.section}<br>`{row.id}`", row.says, row.here, _link(row), row.reason)
            for row in rows
            if row.paper == paper
        ]
        escaped = [[cell.replace("|", "\\|").replace("*", "\\*") for cell in line] for line in cells]
        text += ["", f"## {title}", "", *markdown_table(COLUMNS, escaped)]
    return "\n".join(text) + "\n"


def write_page(folder: Path) -> Path:
    """Write trust/claims.md and return its path, or raise `FileError`."""
    make_folder(folder / "trust")
    path = folder / "trust" / "claims.md"
    write_text(path, page())
    return path


def _link(row: Row) -> str:
    return f"experiment [{row.experiment}](paper.md#{row.experiment})" if row.experiment else row.status


def _totals(rows: Sequence[Row]) -> list[list[str]]:
    """Return the counts as lines of cells: a header, a line for each paper, and the sums."""
    numbers = counts(rows)
    lines = [[paper, *map(str, one.values()), str(sum(one.values()))] for paper, one in numbers.items()]
    sums = [str(sum(one[status] for one in numbers.values())) for status in get_args(Status)]
    return [["paper", *get_args(Status), "all"], *lines, ["all", *sums, str(len(rows))]]
