"""``splatcl decimate``: fewer, larger splats."""

from __future__ import annotations

import time

from splatcl.cli.options.inputs import OnInvalidOption, ScanArgument, read_splats
from splatcl.cli.options.outputs import SplatsOption, save_splats, seconds_since
from splatcl.io.write import check_output


def decimate(
    scan: ScanArgument,
    /,
    *,
    output: SplatsOption,
    error: float,
    angle: float = 30.0,
    fields: bool = False,
    on_invalid: OnInvalidOption = "error",
) -> None:
    """Cover a scan with fewer, larger splats within an error bound.

    Parameters
    ----------
    error : float
        Largest distance from a center to the splat that covers it, scene units.
    angle : float
        Largest angle between the normals of a splat and the one that covers it, degrees, up to 60.
    fields : bool
        Fit a normal field to the normals that each splat covers, for `splatcl render --method botsch04`.
    """
    import splatcl

    check_output(output)
    splats = read_splats(scan, on_invalid)
    start = time.perf_counter()
    fewer = splatcl.decimate(splats, error, angle=angle, fields=fields)
    share = len(splats) / max(len(fewer), 1)
    print(f"decimated {len(splats)} splats to {len(fewer)} (1 for {share:.3g}) in {seconds_since(start)}")
    save_splats(fewer, output, num_printed=len(splats.notes) + 1)  # the first new note says the same
