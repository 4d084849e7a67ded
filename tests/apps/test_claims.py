"""`splatcl paper list`: the rows of claims.toml, what a row may say, the printed table and the page."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tomllib

import pytest
from helpers.paths import ROOT

from splatcl.apps.paper import claims_report, report
from splatcl.apps.paper.catalogue import EXPERIMENTS
from splatcl.apps.paper.claims import Row, chosen_rows, claims, counts, parsed
from splatcl.cli import main

ENTRY = {"id": "one", "paper": "ZRB04", "section": "1", "says": "It is so.", "kind": "claim"}
PAGE = ROOT / "docs" / "trust" / "claims.md"


def test_every_paper_has_its_rows():
    rows = claims()
    assert len(rows) == 386 and len({row.id for row in rows}) == 386
    assert {paper: sum(one.values()) for paper, one in counts(rows).items()} == {
        "BHZK05": 195,
        "slides": 57,
        "ZRB04": 134,
    }
    assert all(row.id.startswith(row.paper.lower()) for row in rows)


def test_every_experiment_has_rows_and_none_holds_unmeasured():
    assert set(EXPERIMENTS) <= {row.experiment or row.proposed for row in claims()}
    verdicts = {"definition", "not rerun", *(f"experiment {name}" for name in EXPERIMENTS)}
    assert {row.verdict for row in claims()} <= verdicts
    assert all(row.check for row in claims() if row.experiment)
    assert "list" not in EXPERIMENTS


def test_rows_refer_to_rows_that_exist():
    names = {row.id for row in claims()}
    text = " ".join(f"{row.check} {row.why}" for row in claims())
    assert set(re.findall(r"\b(?:bhzk05|slides|zrb04)-[\w-]*\w", text)) <= names


def test_statements_are_short():
    for row in claims():
        assert max(len(part.split()) for part in re.split(r"(?<=[.;:])\s", row.says)) <= 25, row.id


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({}, "either an experiment or a status"),
        ({"experiment": "holes", "status": "definition"}, "either an experiment or a status"),
        ({"experiment": "hole"}, "no experiment 'hole'; name it as proposed"),
        ({"status": "holds"}, "status must be one of experiment, definition, not rerun"),
        ({"status": "not rerun"}, "needs a reason"),
        ({"status": "not rerun", "proposed": "sprite"}, "needs a check"),
        ({"status": "definition", "proposed": "sprite", "check": "Loss 0."}, "the status 'not rerun'"),
        ({"status": "definition", "paper": "BK03"}, "paper must be one of BHZK05, slides, ZRB04"),
        ({"status": "definition", "kind": "guess"}, "kind must be one of claim, "),
        ({"status": "definition", "says": ""}, "must not be empty"),
    ],
)
def test_a_row_that_contradicts_itself(given, message):
    with pytest.raises(ValueError, match=message):
        parsed([ENTRY | given])


def test_an_id_twice():
    with pytest.raises(ValueError, match="row 'one': the id occurs twice"):
        parsed([ENTRY | {"status": "definition"}] * 2)


def test_the_reason_of_a_row():
    (measured,) = parsed([ENTRY | {"experiment": "holes", "why": "In part."}])
    assert (measured.verdict, measured.reason) == ("experiment holes", "In part.")
    missing = Row(**ENTRY, status="not rerun", proposed="sprite", check="Loss 0.", why="Ours is exact.")
    assert missing.reason == "no experiment measures it yet: Loss 0. Ours is exact."
    undecided = Row(**ENTRY, status="not rerun", proposed="holes", check="Loss 0.")
    assert undecided.reason == "holes does not decide it yet: Loss 0."


def test_the_page_is_that_of_the_data(tmp_path, capsys):
    assert main(["paper", "list", "--docs", str(tmp_path)]) == 0
    assert capsys.readouterr().out == f"wrote {tmp_path / 'trust' / 'claims.md'}\n"
    written = (tmp_path / "trust" / "claims.md").read_text()
    assert written == PAGE.read_text(), "run: splatcl paper list --docs docs"
    assert all(f"`{row.id}`" in written for row in claims())
    rows = [line for line in written.splitlines() if "<br>`" in line]
    assert len(rows) == 386 and all(len(re.findall(r"(?<!\\)\|", line)) == 6 for line in rows)
    assert "(claims.md)" in report.INTRODUCTION


def test_the_printed_rows_of_one_paper_and_status(capsys):
    assert main(["paper", "list", "--paper", "slides", "--status", "experiment"]) == 0
    out = capsys.readouterr().out
    rows = chosen_rows("slides", "experiment")
    assert rows and all(row.verdict.split()[1] in out for row in rows)
    assert re.search(rf"slides +{len(rows)} +0 +0 +{len(rows)}", out) and "ZRB04 " not in out


def test_json_and_refused_options(capsys):
    assert main(["paper", "list", "--json", "--status", "not rerun"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert [row["id"] for row in printed["rows"]] == [row.id for row in chosen_rows(status="not rerun")]
    assert all(row["reason"] for row in printed["rows"])
    assert printed["counts"] == counts(chosen_rows(status="not rerun"))
    assert main(["paper", "list", "--docs", "docs", "--json"]) == 2
    assert "leave out --paper, --status and --json" in capsys.readouterr().err


def test_the_list_needs_no_opencl():
    script = (
        "import sys; from splatcl.cli import main; assert main(['paper', 'list', '--json']) == 0; "
        "assert 'pyopencl' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", script], check=True, capture_output=True, timeout=120)


def test_the_wheel_carries_the_rows():
    """By the patterns of pyproject.toml."""
    patterns = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["package-data"]
    folder = ROOT / "splatcl" / "apps" / "paper"
    carried = {path for pattern in patterns["splatcl.apps.paper"] for path in folder.glob(pattern)}
    assert carried == {path for path in folder.iterdir() if path.is_file() and path.suffix not in (".py", ".pyc")}
    assert claims_report.TITLES.keys() == counts(claims()).keys()
