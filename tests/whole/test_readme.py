"""The README's examples run as printed."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from helpers.paths import ROOT

from splatcl.cli import main
from splatcl.io.read import READERS

README = (ROOT / "README.md").read_text()
PYTHON = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
CONSOLE = [re.findall(r"^\$ (splatcl .*)$", block, re.MULTILINE) for block in README.split("```console\n")[1:]]
COMMANDS = [commands for commands in CONSOLE if commands]
"""Commands of each block, in order: later ones may read the files of earlier ones."""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Return a scratch folder where the README's relative paths lead to the checkout's files."""
    (tmp_path / "reference_images").symlink_to(ROOT / "reference_images")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_there_are_examples():
    assert len(PYTHON) == 2 and [len(commands) for commands in COMMANDS] == [3, 3, 4]
    assert len(PYTHON[0].splitlines()) == 10  # the heading promises ten lines


@pytest.mark.parametrize("code", PYTHON)
def test_python_examples_run(folder, code):
    subprocess.run([sys.executable, "-W", "error", "-c", code], check=True, timeout=120)


@pytest.mark.parametrize("commands", COMMANDS)
def test_commands_run(folder, commands):
    program = str(Path(sys.executable).parent / "splatcl")
    for command in commands:
        words = [program, *command.partition("#")[0].split()[1:]]
        result = subprocess.run(words, check=False, timeout=120, capture_output=True, text=True, env=os.environ)
        assert result.returncode == 0, result.stderr
        for output in re.findall(r"\S+\.(?:exr|png)", command):
            assert (folder / output).stat().st_size > 1000


def test_the_table_of_topics_names_real_commands_and_options(capsys):
    table = README.partition("## What it does")[2].partition("\n## ")[0]
    topics = re.findall(r"^\| [^|]+ \| (`splatcl [^|]+) \|", table, re.MULTILINE)
    assert len(topics) == 8
    for command, *options in (words.split() for cell in topics for words in re.findall(r"`splatcl ([^`]+)`", cell)):
        assert main([command, "--help"]) == 0
        printed = capsys.readouterr().out
        assert all(f"{option} " in printed for option in options), command


def test_the_table_of_formats_is_complete():
    """Mutation: another extension in READERS."""
    table = README.partition("| reads |")[2].partition("\n\n")[0]
    rows = [[re.findall(r"`([^`]+)`", cell) for cell in row.split("|")] for row in table.splitlines()[2:]]
    assert sorted(extension for row in rows for extension in row[1]) == sorted(READERS)
    for _, extensions, _, readers, *_ in rows:
        assert {f"{READERS[extension].split('.')[0]}.py" for extension in extensions} <= set(readers)
        assert all((ROOT / "splatcl" / "io" / "readers" / reader).exists() for reader in readers)


def test_the_diagram_has_a_box_for_every_file_of_the_passes():
    diagram = README.partition("```text\n")[2].partition("```")[0]
    passes = {path.stem for path in (ROOT / "splatcl" / "opencl" / "passes").glob("*.py")} - {"__init__"}
    assert sorted(re.findall(r"\[ (\w+) \]", diagram)) == sorted(passes)


def test_relative_links_lead_somewhere():
    for target in re.findall(r"\]\(((?!https?:)[^)#]+)\)", README):
        assert (ROOT / target).exists(), target
