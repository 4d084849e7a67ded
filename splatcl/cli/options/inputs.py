"""The scan that a command reads, and the camera that frames it."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from splatcl.cli.options.groups import FILES
from splatcl.cli.options.outputs import seconds_since
from splatcl.cli.options.view import View
from splatcl.scene.camera import Camera
from splatcl.scene.splats import OnInvalid, Splats
from splatcl.util.progress import stage

ScanArgument = Annotated[
    Path,
    Parameter(group=FILES, help="Scan: PLY, LAS, PCD, OBJ, STL, text or another file that `splatcl info` reads."),
]
OnInvalidOption = Annotated[
    OnInvalid,
    Parameter(
        group=FILES,
        help="Points, triangles or splats with non-finite numbers or no area: stop with an error, or drop them.",
    ),
]


def read_splats(scan: Path, on_invalid: OnInvalid, say: Callable[[str], None] = print) -> Splats:
    """Return the splats of a file; `say` prints a line for each thing done."""
    from splatcl.io.read import read

    start = time.perf_counter()
    with stage(f"Reading {scan.name}"):
        splats = read(scan, on_invalid)
    say(f"read {scan}: {len(splats)} splats in {seconds_since(start)}")
    for note in splats.notes:
        say(f"note: {note}")
    return splats


def read_scan(
    scan: Path, on_invalid: OnInvalid, view: View, camera: Camera | None, say: Callable[[str], None] = print
) -> tuple[Splats, Camera]:
    """Return the splats of a file and a camera: `camera`, or else one that frames the splats."""
    from splatcl.io.read import up_axis

    splats = read_splats(scan, on_invalid, say)
    if camera:
        return splats, camera
    framed = splats.without_outliers()
    if len(framed) < len(splats):
        say(f"note: the framing ignores {len(splats) - len(framed)} outliers; the image includes them")
    camera, turned = view.facing(framed, up_axis(scan))
    if turned:
        say("note: the camera is at azimuth 180, where the normals point; --azimuth 0 shows the other side")
    return splats, camera
