"""``--device``, ``--tile-size`` and ``--allow-inexact``: where a command computes."""

from __future__ import annotations

from typing import Annotated

from cyclopts import Parameter

from splatcl.cli.options.groups import DEVICE

DeviceOption = Annotated[
    str | None,
    Parameter(
        group=DEVICE,
        metavar="DEVICE",
        help="OpenCL device: an index of `splatcl devices`, or words of its name and version "
        "[default: $SPLATCL_DEVICE, else device 0].",
    ),
]
TileSizeOption = Annotated[
    int,
    Parameter(
        group=DEVICE,
        metavar="PIXELS",
        help="Side of a tile, 8, 16, 32 or 64 pixels. It changes the speed, not the image.",
    ),
]
AllowInexactOption = Annotated[
    bool,
    Parameter(
        group=DEVICE,
        help="Compute even where the device or the environment may change bits of the image (see `splatcl doctor`). "
        "The .exr records it.",
    ),
]
