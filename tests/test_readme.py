"""The README's examples run as printed."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text()
PYTHON = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
COMMANDS = re.findall(r"^\$ (splatcl .*)$", README, re.MULTILINE)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A scratch folder in which the README's relative paths lead to the checkout's files."""
    (tmp_path / "reference_images").symlink_to(ROOT / "reference_images")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_there_are_examples():
    assert len(PYTHON) == 2 and len(COMMANDS) == 7


@pytest.mark.parametrize("code", PYTHON)
def test_python_examples_run(folder, code):
    subprocess.run([sys.executable, "-W", "error", "-c", code], check=True, timeout=120)


@pytest.mark.parametrize("command", COMMANDS)
def test_commands_run(folder, command):
    program = str(Path(sys.executable).parent / "splatcl")
    words = [program, *command.partition("#")[0].split()[1:]]
    result = subprocess.run(words, check=False, timeout=120, capture_output=True, text=True, env=os.environ)
    assert result.returncode == 0, result.stderr
    for output in re.findall(r"\S+\.(?:exr|png)", command):
        assert (folder / output).stat().st_size > 1000


def test_relative_links_lead_somewhere():
    for target in re.findall(r"\]\(((?!https?:)[^)#]+)\)", README):
        assert (ROOT / target).exists(), target
