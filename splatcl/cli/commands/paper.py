"""``splatcl paper``: figures, tables and claims of the papers, computed again."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from splatcl.cli.options.device import DeviceOption
from splatcl.errors import SettingsError
from splatcl.util.progress import stage

QUICK = 0.5
"""Scale of the images of a --quick run."""


def paper(
    *names: str,
    output: Annotated[Path, Parameter(alias="-o")] = Path("out/paper"),
    quick: bool = False,
    docs: Path | None = None,
    device: DeviceOption = None,
) -> None:
    """Rerun figures, tables and claims of the papers: numbers, verdicts and images.

    Parameters
    ----------
    names : str
        Experiments to run, such as targets or holes [default: all].
    output : path
        Folder for index.md and its images.
    quick : bool
        Render images of half the size, under a minute once the kernels are built.
    docs : path
        Folder for trust/paper.md and images/paper_*.png, in place of --output. It needs all experiments.
    """
    import splatcl
    from splatcl.apps.paper.catalogue import chosen
    from splatcl.apps.paper.experiment import Run
    from splatcl.apps.paper.report import make_folder, print_result, write_docs, write_folder

    if docs and names:
        raise SettingsError("--docs needs all experiments; leave out their names")
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
