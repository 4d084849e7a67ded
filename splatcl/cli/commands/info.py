"""``splatcl info``: a summary of a scan."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from splatcl.cli.options.inputs import ScanArgument

if TYPE_CHECKING:
    from splatcl.io.inspect import Summary


def info(file: ScanArgument, /) -> None:
    """Print the attributes, extent and spacing of a scan, and the points that cannot be used."""
    from splatcl.io.inspect import inspect

    summary = inspect(file)
    print(f"{summary.path}: {summary.format}")
    for name, value in facts(summary):
        print(f"{name:<11} {value}")
    for note in summary.notes:
        print(f"note: {note}")


def facts(summary: Summary) -> Iterator[tuple[str, str]]:
    """Yield the label and text of each line of a summary; lengths are in scene units."""
    yield "points", str(summary.num_points)
    if summary.num_faces:
        yield "triangles", str(summary.num_faces)
    yield "attributes", ", ".join(summary.attributes) or "none but positions"
    for name, corner in zip(("minimum", "maximum"), summary.bounds, strict=True):
        yield name, " ".join(f"{coordinate:.9g}" for coordinate in corner)
    yield "size", " ".join(f"{extent:.6g}" for extent in summary.bounds[1] - summary.bounds[0])
    yield "spacing", f"{summary.spacing:.6g} (median distance to the nearest neighbor)"
    for count, reason in summary.skipped or ((0, ""),):
        yield "skipped", f"{count} {reason}" if count else "nothing"
