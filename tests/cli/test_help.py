"""The text of ``--help``: groups, examples that run, pages that exist."""

from __future__ import annotations

import re
import shlex
from dataclasses import fields

import pytest
from helpers.cli_stub import run
from helpers.paths import ROOT

from splatcl import RenderSettings
from splatcl.apps.sample_scenes import bundled_scan
from splatcl.cli import COMMANDS, RENDER_EXAMPLES
from splatcl.cli.options.groups import SUBJECTS

NAMES = [name for commands in COMMANDS.values() for name in commands]
EXAMPLES = re.findall(r"^    splatcl (.*)$", RENDER_EXAMPLES.replace("\\\n", ""), re.MULTILINE)


@pytest.fixture(scope="module")
def rendered(tmp_path_factory):
    """Return a folder with the scan that the examples read."""
    folder = tmp_path_factory.mktemp("examples")
    (folder / "bunny.pts").symlink_to(bundled_scan())
    return folder


def test_the_examples_are_five():
    assert len(EXAMPLES) == 5 and all(command.startswith("render bunny.pts ") for command in EXAMPLES)


@pytest.mark.parametrize("command", EXAMPLES)
def test_an_example_works(rendered, capsys, monkeypatch, command):
    monkeypatch.chdir(rendered)
    status, _, err = run(capsys, f"{' '.join(shlex.split(command))} --size 64x48")
    assert (status, err) == (0, [])
    outputs = re.findall(r"\S+\.(?:exr|png)", command)
    assert outputs and all((rendered / output).stat().st_size > 300 for output in outputs)


def test_the_examples_stand_at_the_end_of_the_help_of_render_alone(capsys):
    _, out, _ = run(capsys, "render --help")
    assert "\n".join(out).endswith(f"\n\n{RENDER_EXAMPLES}")
    assert all("Examples:" not in run(capsys, f"{name} --help")[1] for name in NAMES if name != "render")


def test_every_setting_stands_in_one_panel():
    """A setting without a panel would be missing in the help."""
    shown = [name for names in SUBJECTS.values() for name in names]
    settings = {field.name.replace("_", "-") for field in fields(RenderSettings)}
    assert len(shown) == len(set(shown))
    assert set(shown) == settings - {"lights", "user-shader-name"} | {"light"}


@pytest.mark.parametrize(
    ("command", "expected"),
    [
        ("", [*COMMANDS, "Help"]),
        ("render", ["Input and output", "Camera", *SUBJECTS, "Evidence", "Device"]),
        ("probe", ["Arguments", "Input and output", "Options", "Camera", *SUBJECTS, "Device"]),
        ("shade", ["Input and output", "Color and lights", "Device"]),
        ("decimate", ["Input and output", "Options"]),
        ("devices", ["Device"]),
    ],
)
def test_the_panels_in_order(capsys, command, expected):
    _, out, _ = run(capsys, f"{command} --help")
    assert re.findall(r"^╭─ (.*?) ─", "\n".join(out), re.MULTILINE) == expected


@pytest.mark.parametrize("name", NAMES)
def test_every_option_has_its_help(capsys, name):
    """Each row of an option has words, and no default is a Python word."""
    _, out, _ = run(capsys, f"{name} --help")
    rows = [line for line in out if re.match(r"│ [* ]*--", line)]
    assert (rows and all(re.search(r"\S  +[^\s│]", line) for line in rows)) or name == "info"
    assert not [line for line in out if re.search(r"default: (None|False|\()", line)]


@pytest.mark.parametrize("name", NAMES)
def test_the_pages_in_the_help_exist(capsys, name):
    _, out, _ = run(capsys, f"{name} --help")
    for page in re.findall(r"docs/[\w/]*\w(?:\.md)?", "\n".join(out)):
        assert (ROOT / page).exists(), page
