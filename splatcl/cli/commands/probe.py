"""``splatcl probe``: the history of one pixel."""

from __future__ import annotations

import sys

from splatcl.cli.options.device import DeviceOption
from splatcl.cli.options.inputs import OnInvalidOption, ScanArgument, read_scan
from splatcl.cli.options.settings import SettingsOptions
from splatcl.cli.options.view import View, ViewOptions
from splatcl.util.progress import stage


def probe(
    scan: ScanArgument,
    x: int,
    y: int,
    /,
    *,
    json: bool = False,
    on_invalid: OnInvalidOption = "error",
    view: ViewOptions = None,
    settings: SettingsOptions = None,
    device: DeviceOption = None,
) -> None:
    """Explain one pixel of a render: list each splat that touches it or nearly does, and its part in the result.

    Parameters
    ----------
    x : int
        Column of the pixel, 0 at the left.
    y : int
        Row of the pixel, 0 at the top.
    json : bool
        Print JSON instead of a table.
    """
    import splatcl

    view = view or View()
    camera = view.file_camera()
    renderer = splatcl.Renderer(device=device)
    splats, camera = read_scan(scan, on_invalid, view, camera, lambda line: print(line, file=sys.stderr))
    with stage("Rendering"):
        result = renderer.render(splats, camera, settings).probe(x, y)
    print(result.to_json() if json else result)
