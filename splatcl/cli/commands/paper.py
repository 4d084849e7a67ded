"""``splatcl paper``: the papers' claims, rerun."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from splatcl.errors import SettingsError
from splatcl.util.progress import stage

QUICK = 0.5
"""Lengths of images under --quick, in units of the full run's."""


def paper(
    *names: str,
    output: Annotated[Path, Parameter(alias="-o")] = Path("out/paper"),
    quick: bool = False,
    docs: Path | None = None,
    device: str | None = None,
) -> None:
    """Rerun figures, tables and claims of the papers: numbers, whether each holds, and images (docs/trust/paper.md).

    Parameters
    ----------
    names : str
        Experiments, such as targets or holes [default: all].
    output : path
        Folder for index.md and the images.
    quick : bool
        Images of half the size: under a minute once the kernels are built.
    docs : path
        Folder for trust/paper.md and images/paper_*.png, instead of the other one; of all experiments.
    device : str
        OpenCL device: an index of `splatcl devices`, or words of its name and version.
    """
    import splatcl
    from splatcl.apps.paper.catalogue import chosen
    from splatcl.apps.paper.experiment import Run
    from splatcl.apps.paper.report import make_folder, print_result, write_docs, write_folder

    if docs and names:
        raise SettingsError("--docs is of all experiments: leave their names out")
    experiments = chosen(names)
    make_folder(docs or output)
    run = Run(splatcl.Renderer(device=device), QUICK if quick else 1.0)
    results = []
    with stage("Rerunning the papers", total=len(experiments)) as advance:
        for experiment in experiments:
            results.append(experiment(run))
            advance(1)
    for result in results:
        print_result(result)
    if docs:
        write_docs(docs, results)
    else:
        write_folder(output, results)
    print(f"wrote {docs / 'trust' / 'paper.md' if docs else output / 'index.md'}")
