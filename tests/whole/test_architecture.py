"""The layout of docs/architecture.md: imports go down, a pass has its four files, files and folders stay small."""

from __future__ import annotations

import ast
import importlib.util
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import splatcl

ROOT = Path(__file__).parents[2]
HOME = "splatcl/opencl/passes/{}.py", "kernels/passes/{}.cl", "splatcl/oracle/{}.py", "tests/passes/test_{}.py"
"""Patterns of the four places of a pass."""
EVIDENCE = "splatcl/evidence/{}.py", "kernels/evidence/{}.cl", "tests/evidence/test_{}.py"
"""Patterns of the places of a question about a frame or a device; it asks the oracle, so it has no place there."""
QUESTIONS = ("margin", "envelope", "probe", "accounting", "doctor")
EXCEPTIONS = {
    "kernels/passes/shadow.cl": "a shadow map is drawn by the visibility pass; kernels/shading/shadow.h reads it",
    "splatcl/oracle/occlusion.py": "no bit of an image depends on it",
    "splatcl/oracle/user_shader.py": "its text is OpenCL C",
}
"""Places that a pass lacks, with the reasons."""
CROWDED = ("splatcl/io/readers", "splatcl/cli/commands", "splatcl/apps/bench", "splatcl/oracle")
"""Folders of more than nine modules: one for each format, command or pass."""
LONG = {
    "splatcl/scene/settings.py": "one record; a third of it is the meaning of each setting",
    "splatcl/scene/splats.py": "one record and its checks",
    "kernels/passes/project.cl": "one pass; its bounds, ellipses and records are headers already",
    "kernels/evidence/nearby.cl": "one pass over the splats; its functions have no other user",
}
"""Files over 300 lines, with the reasons not to split them."""


def modules(root):
    return [path for path in sorted((root / "splatcl").rglob("*.py")) if "__pycache__" not in path.parts]


def missing_places(root):
    """Return the places that the passes and the questions of `root` lack without a reason."""
    passes = [path.stem for path in (root / "splatcl/opencl/passes").glob("*.py") if path.stem != "__init__"]
    wanted = [place.format(word) for word in passes for place in HOME]
    wanted += [place.format(word) for word in QUESTIONS for place in EVIDENCE]
    return sorted(place for place in wanted if place not in EXCEPTIONS and not (root / place).exists())


def uses_of_the_public_names(root):
    """Return the modules below `apps` that import a public name from splatcl itself."""
    found = []
    for path in modules(root):
        above = path.relative_to(root / "splatcl").parts[0] in ("apps", "cli", "__init__.py", "__main__.py")
        for node in [] if above else ast.walk(ast.parse(path.read_text())):
            names = {alias.name for alias in node.names} if isinstance(node, ast.Import | ast.ImportFrom) else set()
            if isinstance(node, ast.Import) and "splatcl" in names:
                found.append(path.name)
            if isinstance(node, ast.ImportFrom) and node.module == "splatcl" and names & {*splatcl.__all__}:
                found.append(path.name)
    return found


def broken_contracts(root):
    """Return the contracts of pyproject.toml that the imports of `root` break."""
    code = "from importlinter.cli import lint_imports_command; lint_imports_command(['--no-cache'])"
    done = subprocess.run([sys.executable, "-c", code], cwd=root, capture_output=True, text=True)
    broken = re.findall(r"^(.+) BROKEN$", done.stdout, re.M)
    assert (done.returncode == 0) == (not broken), done.stdout + done.stderr
    return broken


@pytest.fixture
def copy(tmp_path):
    """Return the folder of a copy of the sources, which a test may spoil."""
    for folder in ("splatcl", "kernels", "tests/passes", "tests/evidence"):
        shutil.copytree(ROOT / folder, tmp_path / folder, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    return tmp_path


def add(path, line):
    path.write_text(f"{path.read_text()}\n{line}\n")


def test_every_import_goes_down():
    assert broken_contracts(ROOT) == []


def test_a_deliberate_upward_import_and_a_circle_are_found(copy):
    add(copy / "splatcl/scene/camera.py", "def late():\n    from splatcl.io.cameras import read_camera as read_camera")
    assert "Every import goes down" in broken_contracts(copy)
    shutil.copy(ROOT / "splatcl/scene/camera.py", copy / "splatcl/scene/camera.py")
    add(copy / "splatcl/scene/lights.py", "from splatcl.scene.settings import RenderSettings as RenderSettings")
    assert broken_contracts(copy) == ["No circles at any depth"]


def test_every_pass_has_its_four_places(copy):
    assert missing_places(ROOT) == []
    (copy / "splatcl/opencl/passes/blur.py").write_text("")
    assert missing_places(copy) == sorted(place.format("blur") for place in HOME[1:])
    (copy / "splatcl/opencl/passes/blur.py").unlink()
    (copy / "tests/passes/test_visibility.py").unlink()
    assert missing_places(copy) == ["tests/passes/test_visibility.py"]


def test_exceptions_are_needed():
    assert all(not (ROOT / place).exists() for place in EXCEPTIONS)
    assert all((ROOT / place).read_text().count("\n") > 300 for place in LONG)


def test_the_library_does_not_import_its_own_public_names(copy):
    assert uses_of_the_public_names(ROOT) == []
    add(copy / "splatcl/evidence/margin.py", "from splatcl import render as render")
    assert uses_of_the_public_names(copy) == ["margin.py"]


def test_folders_and_files_stay_small():
    folders = {path.parent for path in modules(ROOT)}
    for folder in folders:
        num = len([path for path in folder.glob("*.py") if path.stem != "__init__"])
        assert num <= 9 or str(folder.relative_to(ROOT)) in CROWDED, folder
    sources = [*modules(ROOT), *(ROOT / "kernels").rglob("*.cl"), *(ROOT / "kernels").rglob("*.h")]
    long = {str(path.relative_to(ROOT)) for path in sources if path.read_text().count("\n") > 300}
    assert long == set(LONG)


def test_the_picture_is_up_to_date():
    spec = importlib.util.spec_from_file_location("architecture", ROOT / "docs" / "images" / "architecture.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    assert (ROOT / "docs" / "images" / "architecture.svg").read_text() == module.drawn()


def test_every_package_is_in_the_wheel():
    listed = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["packages"]
    found = {".".join(path.parent.relative_to(ROOT).parts) for path in modules(ROOT)}
    assert set(listed) == found | {"splatcl.kernels"}
