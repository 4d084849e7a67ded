"""Render the reference images again: ``python reference_images/regenerate.py [--check] [NAME ...]``.

Build each scene from code, render it and compare it with the float64 oracle. If they agree, write its splats, scene,
EXR and PNG, and the tables of README.md. ``--check`` writes nothing. It reports the comparison with the oracle, and
whether the image has the bits of the stored one.
"""

from __future__ import annotations

import argparse
import dataclasses
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from oracle_comparison import compare
from page import write_page
from reference_scenes import SCENES
from scene_files import write_scene

from splatcl import Frame, Renderer, SplatclError, __version__
from splatcl.io.exr import read_exr

FOLDER = Path(__file__).resolve().parent
SOURCES = ("splatcl", "kernels", "reference_images/*.py")
"""Sources that decide an image's bits. Uncommitted changes of these are recorded."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command and return its exit status: 1 if an image disagrees."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME", help="scenes to render; all by default")
    parser.add_argument("--check", action="store_true", help="write nothing")
    options = parser.parse_args(arguments)
    unknown = [name for name in options.names if name not in SCENES]
    if unknown:
        parser.error(f"no scene {unknown[0]!r}; there are {', '.join(SCENES)}")
    renderer = Renderer()
    num_bad = sum(not regenerate(name, renderer, FOLDER, options.check) for name in options.names or SCENES)
    if not options.check:
        write_page(FOLDER, SCENES)
    if num_bad:
        print(f"{num_bad} scenes disagree" + ("" if options.check else " and were not written"), file=sys.stderr)
    return 1 if num_bad else 0


def regenerate(name: str, renderer: Renderer, folder: Path, check: bool = False) -> bool:
    """Render one scene, compare it and print the result. Write it if it agrees, never under `check`.

    Returns
    -------
    bool
        Whether it agrees with the oracle and, under `check`, with the bits of the stored image.
    """
    scene = SCENES[name]()
    frame = renderer.render(scene.splats, scene.camera, scene.settings)
    comparison = compare(scene, frame)
    problems = comparison.problems
    if check and not same_bits(folder / f"{name}.exr", frame):
        problems = (*problems, f"not the bits of {name}.exr")
    print(f"{name:20} {comparison}" + "".join(f"\n  {problem}" for problem in problems))
    if problems:
        return False
    if not check:
        made = {
            "splatcl": __version__,
            "commit": git_commit(),
            "device": frame.metadata["device"],
            "oracle": comparison.record(),
        }
        write_scene(folder, name, dataclasses.replace(scene, made=made), frame)
    return True


def same_bits(path: Path, frame: Frame) -> bool:
    """Return whether the EXR at `path` holds exactly this frame's AOVs."""
    try:
        stored, _, _ = read_exr(path)
    except SplatclError:
        return False
    return stored.keys() == set(frame) and all(
        stored[aov].tobytes() == np.asarray(frame[aov], stored[aov].dtype).tobytes() for aov in stored
    )


def git_commit() -> str:
    """Return the checked-out commit, with "+ changes" if the sources differ from it; "unknown" outside of git."""
    try:
        commit = _git("rev-parse", "--short=12", "HEAD")
        return commit + (" + changes" if _git("status", "--porcelain", "--", *SOURCES) else "")
    except (OSError, subprocess.CalledProcessError):
        return "unknown"


def _git(*arguments: str) -> str:
    command = ["git", "-C", str(FOLDER.parent), *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()


if __name__ == "__main__":
    sys.exit(main())
