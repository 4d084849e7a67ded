"""Compare splatcl in turn with another renderer: the OpenGL passes of examples/backend_gl on Mesa's llvmpipe."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from splatcl.apps.bench.matrix import BASE, size_name
from splatcl.apps.bench.measure import render_and_wait
from splatcl.apps.sample_scenes import fibonacci_sphere, frame_camera
from splatcl.apps.timing import Spread, seconds_of, turn_by_turn
from splatcl.errors import SplatclError
from splatcl.opencl.session import UploadedSplats
from splatcl.renderer import Renderer
from splatcl.scene.settings import Facing
from splatcl.util.progress import Advance, stage

BACKEND = Path(__file__).parents[3] / "examples" / "backend_gl" / "backend.py"
"""Path of the other renderer in a checkout; an installed splatcl has none."""
SIZES = (1_000_000, 4_000_000)
"""Default numbers of splats."""
FACINGS: tuple[Facing, ...] = ("cull", "keep")
SIZE = 512
"""Width and height of the images, pixels."""
SECONDS = 90.0
"""Time after which a comparison starts no further round, seconds."""


@dataclass(frozen=True)
class Comparison:
    """Times and differences of one scene in both renderers.

    `theirs_sorted` has the splats sorted along a space-filling curve. `difference` is the mean absolute difference of
    RGB where both images have a splat; `coverage_differs` is the share of pixels where only one has.
    """

    num_splats: int
    facing: Facing
    renderer_name: str
    ours: Spread
    theirs: Spread
    theirs_sorted: Spread
    difference: float
    coverage_differs: float

    @property
    def ratio(self) -> float:
        """Ratio of their median time to ours, for splats in the same order."""
        return self.theirs.median / self.ours.median

    @property
    def ratio_sorted(self) -> float:
        """Ratio of their median time, for splats that are already sorted, to ours."""
        return self.theirs_sorted.median / self.ours.median

    def as_json(self) -> dict[str, Any]:
        """Return all fields and ratios as JSON's types; times are in seconds."""
        times = {name: getattr(self, name).as_json() for name in ("ours", "theirs", "theirs_sorted")}
        return vars(self) | times | {"ratio": self.ratio, "ratio_sorted": self.ratio_sorted}


def load_backend(path: Path) -> Any:
    """Import the class `Backend` from a file.

    Raises
    ------
    SplatclError
        The file does not exist, or a module that it imports is missing.
    """
    spec = importlib.util.spec_from_file_location("splatcl_backend_gl", path)
    if not path.exists() or not spec or not spec.loader:
        raise SplatclError(f"--against llvmpipe needs {path}, which does not exist; run it from a checkout")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    try:
        spec.loader.exec_module(module)
    except ModuleNotFoundError as error:
        raise SplatclError(f"--against llvmpipe cannot run without {error.name}; pip install 'splatcl[gl]'") from None
    return module.Backend


def compare(renderer: Renderer, backend_class: Any, sizes: Sequence[int], frames: int) -> Iterator[Comparison]:
    """Render spheres of each size with both renderers, with and without back-face culling.

    Parameters
    ----------
    renderer : Renderer
    backend_class : type
        A class ``Backend(splats, sort=)`` with ``draw(camera, settings)``, which returns at the end of the frame,
        ``read()`` and ``renderer_name``.
    sizes : sequence of int
        Numbers of splats.
    frames : int
        Number of samples of each time.
    """
    for size in sizes:
        with stage(f"Comparing at {size_name(size)} splats", total=3 * len(FACINGS) * frames) as advance:
            uploaded = renderer.upload(fibonacci_sphere(size))
            backends = [backend_class(uploaded.splats, sort=sort) for sort in (False, True)]
            for facing in FACINGS:
                yield _compare(renderer, backends, uploaded, facing, frames, advance)


def _compare(
    renderer: Renderer, backends: Sequence[Any], uploaded: UploadedSplats, facing: Facing, frames: int, advance: Advance
) -> Comparison:
    camera, settings = frame_camera(uploaded.splats, SIZE, SIZE), replace(BASE, facing=facing)
    ours = renderer.render(uploaded, camera, settings).color
    for backend in backends:
        backend.draw(camera, settings)
    theirs = backends[0].read()["color"]
    both = (ours[..., 3] > 0) & (theirs[..., 3] > 0)
    difference = float(np.abs(ours[both][:, :3] - theirs[both][:, :3]).sum() / max(3 * np.count_nonzero(both), 1))
    differs = float(np.mean((ours[..., 3] > 0) != (theirs[..., 3] > 0)))
    frame_of = [partial(render_and_wait, renderer, uploaded, camera, settings)]
    frame_of += [partial(backend.draw, camera, settings) for backend in backends]
    jobs = [lambda work=work: {"frame": seconds_of(work)} for work in frame_of]
    our_time, their_time, sorted_time = (one["frame"] for one in turn_by_turn(jobs, frames, SECONDS, advance))
    name = backends[0].renderer_name
    return Comparison(len(uploaded.splats), facing, name, our_time, their_time, sorted_time, difference, differs)
