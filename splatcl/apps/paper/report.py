"""Write results to the terminal, to a folder of images with an index, and to a page of the documentation."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splatcl.apps.paper.experiment import Result
from splatcl.errors import FileError
from splatcl.frame import Frame
from splatcl.io.png import write_png
from splatcl.util.atomic import atomic_path

WIDTH = 120
"""Columns if the output is not a terminal."""
PER_ROW, GAP = 4, 4
"""Images in a row of a strip, and pixels between them."""
INTRODUCTION = """\
# The papers' claims, rerun

`splatcl paper` reruns figures, tables and claims of [BHZK05] and [ZRB04] and says whether each claim holds, holds in
part, or does not hold. It wrote this page.

```console
$ splatcl paper                # all experiments: numbers, and every image at full size
$ splatcl paper --quick        # images of half the size
$ splatcl paper holes          # one experiment
$ splatcl paper --docs docs    # this page
```

- Each claim is put in our words. It holds if the numbers beside it meet the bound in the experiment's source
  ([splatcl/apps/paper/experiments/](../../splatcl/apps/paper/experiments)).
- Scenes, measures and bounds are ours. Some bounds were set after a first look at the numbers: read the numbers, not
  the verdict alone.
- Speeds depend on the machine and its load. [bench.md](../speed/bench.md) says how to measure them well.
- [claims.md](claims.md) lists every claim of the papers, with those that no experiment measures.
- [specification.md](../specification.md) lists the papers.
"""


def table(result: Result) -> tuple[list[str], list[list[str]]]:
    """Return the figures as columns and rows: a row for each object, a column for each measure."""
    measures = list(dict.fromkeys(figure.measure for figure in result.figures))
    cells = {(figure.of, figure.measure): str(figure) for figure in result.figures}
    rows = dict.fromkeys(figure.of for figure in result.figures)
    return ["", *measures], [[of, *(cells.get((of, measure), "") for measure in measures)] for of in rows]


def print_result(result: Result) -> None:
    """Print the figures and the claims of one experiment."""
    from rich import box
    from rich.console import Console
    from rich.table import Table

    columns, rows = table(result)
    figures = Table(box=box.SIMPLE)
    for place, column in enumerate(columns):
        figures.add_column(column, justify="right" if place else "left")
    for row in rows:
        figures.add_row(*row)
    console = Console(width=None if sys.stdout.isatty() else WIDTH, markup=False, highlight=False)
    console.print(f"{result.name}: {result.title}", style="bold")
    console.print(figures)
    for claim in result.claims:
        console.print(f"{claim.verdict}: {claim.says} {claim.here}")
    for note in result.notes:
        console.print(f"note: {note}")


def write_folder(folder: Path, results: Sequence[Result]) -> None:
    """Write every image as PNG, frames also as OpenEXR, and index.md, or raise `FileError`."""
    make_folder(folder)
    sections = []
    for result in results:
        pictures = []
        for name, image in result.images.items():
            file = f"{result.name}_{slug(name)}.png"
            write_png(folder / file, picture(image))
            pictures.append(f"![{name}]({file})")
            if isinstance(image, Frame):
                image.save(folder / file.replace(".png", ".exr"))
        sections.append((result, pictures))
    write_text(folder / "index.md", "# The papers' claims, rerun\n\n" + page(sections))


def write_docs(folder: Path, results: Sequence[Result]) -> None:
    """Write trust/paper.md, and images/paper_NAME.png for each experiment with images, or raise `FileError`."""
    pages, images = folder / "trust", folder / "images"
    make_folder(pages)
    make_folder(images)
    sections = []
    for result in results:
        pictures = []
        if result.images:
            file = f"paper_{result.name}.png"
            write_png(images / file, strip([picture(image) for image in result.images.values()]))
            pictures = [f"![{result.name}](../images/{file})\n\nFrom the left, row by row: {'; '.join(result.images)}."]
        sections.append((result, pictures))
    write_text(pages / "paper.md", INTRODUCTION + "\n" + page(sections))


def page(sections: Sequence[tuple[Result, list[str]]]) -> str:
    """Return Markdown: a table of all claims, and a section with pictures for each experiment."""
    claims = [
        [f"[{result.name}](#{result.name})", claim.says, claim.here, claim.verdict]
        for result, _ in sections
        for claim in result.claims
    ]
    lines = [*markdown_table(["experiment", "the paper says", "here", ""], claims), ""]
    for result, pictures in sections:
        lines += [f"## {result.name}", "", " ".join([f"{result.title}.", *result.notes]), ""]
        lines += [*markdown_table(*table(result)), ""]
        lines += [f"{shown}\n" for shown in pictures]
    return "\n".join(lines)


def markdown_table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> Iterator[str]:
    """Yield the lines of a table."""
    yield f"| {' | '.join(columns)} |"
    yield "|---" * len(columns) + "|"
    for row in rows:
        yield f"| {' | '.join(row)} |"


def picture(image: Frame | NDArray[Any]) -> NDArray[Any]:
    """Return an image as linear RGBA, (H, W, 4)."""
    color = image.color if isinstance(image, Frame) else image
    if color.ndim == 2:
        color = np.repeat(color[..., None], 3, axis=2)
    return color if color.shape[2] == 4 else np.concatenate([color, np.ones((*color.shape[:2], 1))], axis=2)


def strip(pictures: Sequence[NDArray[Any]]) -> NDArray[Any]:
    """Return (H, W, 4) pictures in rows of `PER_ROW` at most, each in a cell as large as the largest, on white."""
    height, width = np.max([one.shape[:2] for one in pictures], axis=0) + GAP
    rows = -(-len(pictures) // PER_ROW)
    columns = -(-len(pictures) // rows)
    sheet = np.ones((rows * height - GAP, columns * width - GAP, 4))
    for place, one in enumerate(pictures):
        top, left = height * (place // columns), width * (place % columns)
        cell = sheet[top : top + one.shape[0], left : left + one.shape[1], :3]
        alpha = one[..., 3:]
        cell[...] = alpha * one[..., :3] + (1 - alpha) * cell
    return sheet


def slug(name: str) -> str:
    """Return a name in the form for file names."""
    return re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")


def make_folder(folder: Path) -> None:
    """Make a folder and its parents, or raise `FileError`."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileError(f"{folder}: cannot make the folder: {error.strerror or error}") from error


def write_text(path: Path, text: str) -> None:
    """Write a text whole or not at all."""
    with atomic_path(path) as temporary:
        temporary.write_text(text)
