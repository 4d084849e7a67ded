"""``splatcl decimate``: fewer, larger splats."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from splatcl.cli.commands.fields import save_splats
from splatcl.cli.options.view import read_splats
from splatcl.io.write import check_output
from splatcl.scene.splats import OnInvalid


def decimate(
    scan: Path,
    /,
    *,
    output: Annotated[Path, Parameter(alias="-o")],
    error: float,
    angle: float = 30.0,
    fields: bool = False,
    on_invalid: OnInvalid = "error",
) -> None:
    """Cover a scan with fewer, larger splats within an error bound (docs/guide/normal_fields.md).

    Parameters
    ----------
    scan : path
        PLY, text, mesh or other file that `splatcl info` knows.
    output : path
        .ply or .npz file to write.
    error : float
        Largest distance of a centre from the splat that covers it, scene units.
    angle : float
        Largest angle between the normals of the two, degrees, up to 60.
    fields : bool
        Fit normal fields to the normals that each splat covers, for `splatcl render --method botsch04`.
    on_invalid : str
        What to do with splats that have non-finite numbers or no area.
    """
    import splatcl

    check_output(output)
    splats = read_splats(scan, on_invalid)
    start = time.perf_counter()
    fewer = splatcl.decimate(splats, error, angle=angle, fields=fields)
    took = time.perf_counter() - start
    share = len(splats) / max(len(fewer), 1)
    print(f"decimated {len(splats)} splats to {len(fewer)} (1 for {share:.3g}) in {took:.2f} s")
    save_splats(fewer, output, said=len(splats.notes) + 1)  # the first new one says the same
