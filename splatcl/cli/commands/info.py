"""``splatcl info``: what a file holds."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from splatcl.io.inspect import Summary


def info(file: Path, /) -> None:
    """Say what a scan holds and what of it would be left out.

    Parameters
    ----------
    file : path
        PLY, text, mesh or other scan.
    """
    from splatcl.io.inspect import inspect

    summary = inspect(file)
    print(f"{summary.path}: {summary.format}")
    for name, value in facts(summary):
        print(f"{name:<11} {value}")
    for note in summary.notes:
        print(f"note: {note}")


def facts(summary: Summary) -> Iterator[tuple[str, str]]:
    """Yield the name and the text of each fact of a summary; lengths are in scene units."""
    yield "points", str(summary.num_points)
    if summary.num_faces:
        yield "triangles", str(summary.num_faces)
    yield "attributes", ", ".join(summary.attributes) or "none but positions"
    for name, corner in zip(("least", "greatest"), summary.bounds, strict=True):
        yield name, " ".join(f"{coordinate:.9g}" for coordinate in corner)
    yield "size", " ".join(f"{extent:.6g}" for extent in summary.bounds[1] - summary.bounds[0])
    yield "spacing", f"{summary.spacing:.6g} (median distance to the nearest neighbour)"
    for count, reason in summary.skipped or ((0, ""),):
        yield "skipped", f"{count} {reason}" if count else "nothing"
