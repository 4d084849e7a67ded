"""Every claim, definition, parameter, number, figure and table of the papers, as rows of claims.toml."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any, Literal, get_args

from splatcl.apps.paper.catalogue import EXPERIMENTS

Paper = Literal["BHZK05", "slides", "ZRB04"]
Kind = Literal["claim", "definition", "parameter", "number", "figure", "table"]
Status = Literal["experiment", "definition", "not rerun"]


@dataclass(frozen=True)
class Row:
    """One statement of a paper, in our words.

    Parameters
    ----------
    id : str
        Unique name; the checks of other rows refer to it.
    paper, section, kind : str
        Place in the paper and sort of statement.
    says : str
        The statement.
    experiment : str
        Experiment that measures the statement, or empty.
    status : {"experiment", "definition", "not rerun"}
        definition: splatcl does the same by construction, or `here` and `why` say how it differs.
    proposed : str
        Experiment that should measure the statement, or empty. It need not exist yet.
    check : str
        Measure, bound and the source of the bound.
    here : str
        Setting, place or number in splatcl.
    why : str
        Difference to the paper, or the reason why nothing measures the statement.
    """

    id: str
    paper: Paper
    section: str
    says: str
    kind: Kind
    experiment: str = ""
    status: Status = "experiment"
    proposed: str = ""
    check: str = ""
    here: str = ""
    why: str = ""

    def __post_init__(self) -> None:
        """Raise `ValueError` for a row that contradicts itself."""
        if not (self.id and self.section and self.says):
            raise ValueError(f"row {self.id!r}: id, section and says must not be empty")
        for name, choices in (("paper", Paper), ("kind", Kind), ("status", Status)):
            if getattr(self, name) not in get_args(choices):
                raise ValueError(f"row {self.id!r}: {name} must be one of {', '.join(get_args(choices))}")
        if bool(self.experiment) != (self.status == "experiment"):
            raise ValueError(f"row {self.id!r}: give either an experiment or a status")
        if self.experiment and self.experiment not in EXPERIMENTS:
            raise ValueError(f"row {self.id!r}: no experiment {self.experiment!r}; name it as proposed")
        if self.proposed and (self.status != "not rerun" or not self.check):
            raise ValueError(f"row {self.id!r}: a proposed experiment needs a check and the status 'not rerun'")
        if self.status == "not rerun" and not (self.proposed or self.why):
            raise ValueError(f"row {self.id!r}: a row that is not rerun needs a reason")

    @property
    def verdict(self) -> str:
        """Status in words: "experiment NAME", "definition" or "not rerun"."""
        return f"experiment {self.experiment}" if self.experiment else self.status

    @property
    def reason(self) -> str:
        """Reason for the status: for a proposed experiment what it would measure, then `why`."""
        if not self.proposed:
            return self.why
        if self.proposed in EXPERIMENTS:
            missing = f"{self.proposed} does not decide it yet: {self.check}"
        else:
            missing = f"no experiment measures it yet: {self.check}"
        return f"{missing} {self.why}".strip()


@cache
def claims() -> tuple[Row, ...]:
    """Return all rows in the order of the papers, or raise `ValueError`."""
    text = (files("splatcl.apps.paper") / "claims.toml").read_text(encoding="utf-8")
    return parsed(tomllib.loads(text)["claim"])


def parsed(entries: Iterable[Mapping[str, Any]]) -> tuple[Row, ...]:
    """Return the rows of these entries, or raise `ValueError` for a wrong row or an id that occurs twice."""
    rows: dict[str, Row] = {}
    for entry in entries:
        # A row states its status only if no experiment measures it.
        if "experiment" in entry and "status" in entry:
            raise ValueError(f"row {entry['id']!r}: give either an experiment or a status")
        row = Row(**entry)
        if row.id in rows:
            raise ValueError(f"row {row.id!r}: the id occurs twice")
        rows[row.id] = row
    return tuple(rows.values())


def chosen_rows(paper: Paper | None = None, status: Status | None = None) -> tuple[Row, ...]:
    """Return the rows of one paper, of one status, or all."""
    return tuple(row for row in claims() if paper in (None, row.paper) and status in (None, row.status))


def counts(rows: Sequence[Row]) -> dict[str, dict[str, int]]:
    """Return the number of rows by paper and status."""
    return {
        paper: {status: sum((row.paper, row.status) == (paper, status) for row in rows) for status in get_args(Status)}
        for paper in get_args(Paper)
        if any(row.paper == paper for row in rows)
    }
