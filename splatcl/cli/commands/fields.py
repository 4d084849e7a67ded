"""``splatcl fields``: splats with normal fields."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from splatcl.cli.options.view import read_splats
from splatcl.io.write import check_output
from splatcl.scene.splats import OnInvalid, Splats
from splatcl.util.progress import stage


def fields(
    scan: Path,
    /,
    *,
    output: Annotated[Path, Parameter(alias="-o")],
    num_neighbors: int = 12,
    on_invalid: OnInvalid = "error",
) -> None:
    """Estimate how normals turn over each splat, from its neighbours' (docs/guide/normal_fields.md).

    Parameters
    ----------
    scan : path
        PLY, text, mesh or other file that `splatcl info` knows.
    output : path
        .ply or .npz file to write.
    num_neighbors : int
        Nearest neighbours of a splat that are looked at, at least 3.
    on_invalid : str
        What to do with splats that have non-finite numbers or no area.
    """
    import splatcl

    check_output(output)
    splats = read_splats(scan, on_invalid)
    start = time.perf_counter()
    result = splatcl.normal_fields(splats, num_neighbors)
    constant = 0
    if result.normal_du is not None and result.normal_dv is not None:
        constant = int((~(result.normal_du.any(axis=1) | result.normal_dv.any(axis=1))).sum())
    print(f"estimated {len(result)} normal fields in {time.perf_counter() - start:.2f} s; {constant} are constant")
    save_splats(result, output, said=len(splats.notes))


def save_splats(splats: Splats, path: Path, said: int) -> None:
    """Say the notes of splats but the first `said`, write the splats and say so."""
    from splatcl.io.write import write

    for note in splats.notes[said:]:
        print(f"note: {note}")
    start = time.perf_counter()
    with stage(f"Writing {path.name}"):
        write(splats, path)
    print(f"wrote {path} ({path.stat().st_size / 1e6:.2f} MB) in {time.perf_counter() - start:.2f} s")
