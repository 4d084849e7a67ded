"""The package's public names: lazy imports, and names that match their objects."""

from __future__ import annotations

import subprocess
import sys
import tomllib

import pytest
from helpers.paths import ROOT

import splatcl

HEAVY = ("numpy", "pyopencl", "scipy", "rich", "cyclopts", "imageio", "OpenEXR", "plyfile")


def run(script: str) -> str:
    command = [sys.executable, "-c", script]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=True).stdout


def loaded_after(statements: str) -> set[str]:
    return set(run(f"{statements}\nimport sys; print('\\n'.join(sys.modules))").splitlines())


def test_importing_splatcl_imports_nothing_heavy():
    assert not loaded_after("import splatcl") & set(HEAVY)


def test_help_imports_no_numbers():
    loaded = loaded_after("from splatcl.cli import main; main(['--help'])")
    assert "cyclopts" in loaded and not loaded & {"numpy", "pyopencl", "scipy", "splatcl.renderer"}


def test_using_a_name_starts_no_opencl():
    loaded = loaded_after("import splatcl; splatcl.render, splatcl.read, splatcl.Camera")
    assert "numpy" in loaded and not loaded & {"pyopencl", "scipy", "rich", "imageio", "OpenEXR", "plyfile"}


def test_every_name_is_there():
    for name in splatcl.__all__:
        assert getattr(splatcl, name).__name__ == name
    assert {*splatcl.__all__, "__version__"} <= set(dir(splatcl))
    assert splatcl.__all__ == sorted(splatcl._MODULES)
    assert splatcl.__version__[0].isdigit()
    with pytest.raises(AttributeError, match="'splatcl' has no attribute 'splat'"):
        splatcl.splat  # noqa: B018


@pytest.mark.parametrize(
    "first", ["", "import splatcl.renderer", "from splatcl.renderer import Renderer", "splatcl.Camera"]
)
def test_render_is_the_function_whatever_is_imported_first(first):
    assert run(f"import splatcl\n{first}\nprint(splatcl.render.__name__)") == "render\n"


def test_the_wheel_carries_every_kernel():
    """The test expands the patterns of pyproject.toml; .ci/run renders with the wheel itself."""
    root = ROOT
    patterns = tomllib.loads((root / "pyproject.toml").read_text())["tool"]["setuptools"]["package-data"]
    kernels = root / "kernels"
    carried = {path for pattern in patterns["splatcl.kernels"] for path in kernels.glob(pattern)}
    sources = {path for path in kernels.rglob("*") if path.is_file() and path.suffix not in (".py", ".pyc")}
    assert carried == sources
    assert {path.name for path in kernels.iterdir() if path.is_dir()} - {"__pycache__"} == {
        str(path.relative_to(kernels).parts[0]) for path in carried
    }
