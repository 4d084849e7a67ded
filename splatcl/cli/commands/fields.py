"""``splatcl fields``: splats with normal fields."""

from __future__ import annotations

import time

from splatcl.cli.options.inputs import OnInvalidOption, ScanArgument, read_splats
from splatcl.cli.options.outputs import SplatsOption, save_splats, seconds_since
from splatcl.io.write import check_output


def fields(
    scan: ScanArgument,
    /,
    *,
    output: SplatsOption,
    num_neighbors: int = 12,
    on_invalid: OnInvalidOption = "error",
) -> None:
    """Fit a normal field to each splat from its neighbors' normals.

    Parameters
    ----------
    num_neighbors : int
        Number of nearest neighbors that a fit uses, at least 3.
    """
    import splatcl

    check_output(output)
    splats = read_splats(scan, on_invalid)
    start = time.perf_counter()
    result = splatcl.normal_fields(splats, num_neighbors)
    constant = 0
    if result.normal_du is not None and result.normal_dv is not None:
        constant = int((~(result.normal_du.any(axis=1) | result.normal_dv.any(axis=1))).sum())
    print(f"estimated {len(result)} normal fields in {seconds_since(start)}; {constant} are constant")
    save_splats(result, output, num_printed=len(splats.notes))
