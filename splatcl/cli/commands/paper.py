"""``splatcl paper``: figures, tables and claims of the papers, computed again."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import App, Parameter

from splatcl.cli.options.device import DeviceOption
from splatcl.errors import SettingsError
from splatcl.util.progress import stage

QUICK = 0.5
"""Scale of the images of a --quick run."""

paper = App(name="paper", help_epilogue="")
"""Command with its subcommand `list`; no experiment bears that name."""


@paper.default
def rerun(
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


@paper.command(name="list", group="Commands")
def list_claims(
    *,
    paper: Literal["BHZK05", "slides", "ZRB04"] | None = None,
    status: Literal["experiment", "definition", "not rerun"] | None = None,
    json: bool = False,
    docs: Path | None = None,
) -> None:
    """List every claim of the papers with its status. See docs/trust/claims.md.

    Parameters
    ----------
    paper : str
        List the rows of one paper [default: all].
    status : str
        List the rows of one status: those that an experiment measures, definitions, or those that are not rerun.
    json : bool
        Print JSON.
    docs : path
        Folder for trust/claims.md, with all rows, in place of the printed table.
    """
    from splatcl.apps.paper.claims import chosen_rows
    from splatcl.apps.paper.claims_report import as_json, print_rows, write_page

    if docs and (paper or status or json):
        raise SettingsError("--docs takes all rows; leave out --paper, --status and --json")
    if docs:
        print(f"wrote {write_page(docs)}")
        return
    rows = chosen_rows(paper, status)
    if json:
        print(as_json(rows))
    else:
        print_rows(rows)
