"""``splatcl probe``: what happened at one pixel."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from splatcl.cli.options.view import View, read_scan
from splatcl.scene.settings import RenderSettings
from splatcl.scene.splats import OnInvalid
from splatcl.util.progress import stage


def probe(
    scan: Path,
    x: int,
    y: int,
    /,
    *,
    json: bool = False,
    view: Annotated[View | None, Parameter(name="*", group="Camera")] = None,
    settings: Annotated[RenderSettings | None, Parameter(name="*", group="Settings")] = None,
    on_invalid: OnInvalid = "error",
    device: str | None = None,
) -> None:
    """Explain one pixel of a render: every splat that touches it or nearly does, and what became of it.

    Parameters
    ----------
    scan : path
        PLY, text, mesh or other file that `splatcl info` knows.
    x : int
        The pixel's column, from 0 at the left.
    y : int
        Its row, from 0 at the top.
    json : bool
        Print JSON instead of a table.
    on_invalid : str
        What to do with splats that have non-finite numbers or no area.
    device : str
        OpenCL device: an index of `splatcl devices`, or words of its name and version.
    """
    import splatcl

    view = view or View()
    camera = view.file_camera()
    renderer = splatcl.Renderer(device=device)
    splats, camera = read_scan(scan, on_invalid, view, camera, lambda line: print(line, file=sys.stderr))
    with stage("Rendering"):
        result = renderer.render(splats, camera, settings).probe(x, y)
    print(result.to_json() if json else result)
