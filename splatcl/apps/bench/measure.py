"""Measure configurations: first counts, which also compile the kernels, then times in turn."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from splatcl.apps.bench.matrix import Row, size_name
from splatcl.apps.bench.passes import Counts, FramePasses
from splatcl.apps.sample_scenes import fibonacci_sphere, frame_camera, resampled, shuffled, with_field
from splatcl.apps.timing import Spread, seconds_of, turn_by_turn
from splatcl.errors import DeviceError
from splatcl.opencl.session import UploadedSplats
from splatcl.renderer import Renderer
from splatcl.scene.camera import Camera
from splatcl.scene.settings import RenderSettings, effective_settings
from splatcl.scene.splats import Splats
from splatcl.util.progress import stage

MAX_FRAME_SECONDS = 30.0
"""Longest frame of a measured configuration, seconds; slower ones are skipped."""
SECONDS_PER_ROW = 20.0
"""Time for each configuration after which no further round starts, seconds."""
MEMORY_SHARE = 0.8
"""Share of the free memory that a configuration may take."""
FAR = 1e30
"""An epsilon that accepts every fragment, scene units."""


@dataclass(frozen=True)
class Drawn:
    """Numbers of accumulated fragments and of covered pixels of one frame."""

    fragments: int
    pixels: int

    @property
    def per_pixel(self) -> float:
        """Mean number of fragments of a covered pixel."""
        return self.fragments / max(self.pixels, 1)


@dataclass(frozen=True)
class Fragments:
    """Fragments of a frame, of the same frame without and with the pre-filter, and all hits of rays on discs."""

    drawn: Drawn
    without_prefilter: Drawn
    with_prefilter: Drawn
    hits: int


@dataclass(frozen=True)
class Result:
    """Measurements of a configuration. `facing` is the effective one: normals of arbitrary sign are flipped."""

    row: Row
    facing: str
    counts: Counts
    fragments: Fragments
    frame: Spread
    passes: dict[str, Spread]

    @property
    def splats_per_second(self) -> float:
        """Number of splats / median frame time, 1/s."""
        return self.row.num_splats / self.frame.median

    @property
    def shading_share(self) -> float:
        """Share of shading in the sum of the passes' medians."""
        return self.passes["shade"].median / sum(spread.median for spread in self.passes.values())

    def as_json(self) -> dict[str, Any]:
        """Return all measurements as JSON's types; times are in seconds."""
        return {
            "name": self.row.name,
            **asdict(self.row),
            "facing": self.facing,
            "counts": asdict(self.counts),
            "fragments": asdict(self.fragments),
            "splats_per_second": self.splats_per_second,
            "shading_share": self.shading_share,
            "frame": self.frame.as_json(),
            "passes": {name: spread.as_json() for name, spread in self.passes.items()},
        }


@dataclass(frozen=True)
class Skipped:
    """A configuration that was not measured, and the reason."""

    row: Row
    reason: str


class Scenes:
    """The scenes of one number of splats; each is made and uploaded at its first use."""

    def __init__(self, renderer: Renderer, num_splats: int, scan: Splats | None) -> None:
        self._renderer, self._num_splats, self._scan = renderer, num_splats, scan

    def uploaded(self, row: Row) -> UploadedSplats:
        """Return the uploaded splats of a row's scene."""
        if row.model == "scan":
            return self._resampled
        if row.settings.normals == "field":
            return self._with_field
        return self._shuffled if row.order == "shuffled" else self._coherent

    @cached_property
    def _coherent(self) -> UploadedSplats:
        return self._renderer.upload(fibonacci_sphere(self._num_splats))

    @cached_property
    def _shuffled(self) -> UploadedSplats:
        return self._renderer.upload(shuffled(self._coherent.splats))

    @cached_property
    def _with_field(self) -> UploadedSplats:
        return self._renderer.upload(with_field(self._coherent.splats))

    @cached_property
    def _resampled(self) -> UploadedSplats:
        assert self._scan
        return self._renderer.upload(resampled(self._scan, self._num_splats))


class Job:
    """One configuration, ready for timing: splats are uploaded, kernels are compiled, counts are known."""

    def __init__(self, renderer: Renderer, uploaded: UploadedSplats, row: Row) -> None:
        self.row, self._renderer, self._uploaded = row, renderer, uploaded
        self._camera = frame_camera(uploaded.splats, row.width, row.height)
        self._passes = FramePasses(renderer, uploaded, self._camera, row.settings)
        self.fragments = count_fragments(renderer, uploaded, self._camera, row.settings)
        self.counts = self._passes.counts()

    def frame(self) -> None:
        """Render one frame and wait for it, without reading it back."""
        render_and_wait(self._renderer, self._uploaded, self._camera, self.row.settings)

    def times(self) -> dict[str, float]:
        """Time one whole frame ("frame"), and each pass of another frame; return seconds by name."""
        return {"frame": seconds_of(self.frame)} | self._passes.run()

    def result(self, times: dict[str, Spread]) -> Result:
        """Return the counts and `times` as a result."""
        facing = effective_settings(self.row.settings, self._uploaded.splats.oriented).facing
        frame = times.pop("frame")
        return Result(self.row, facing, self.counts, self.fragments, frame, times)


def render_and_wait(renderer: Renderer, uploaded: UploadedSplats, camera: Camera, settings: RenderSettings) -> None:
    """Render one frame on the device and wait for it, without reading it back."""
    renderer.render(uploaded, camera, settings)
    renderer.device.queue.finish()


def count_fragments(
    renderer: Renderer, uploaded: UploadedSplats, camera: Camera, settings: RenderSettings
) -> Fragments:
    """Count the fragments of a frame and of its variants by rendering them."""

    def count(**changes: Any) -> Drawn:
        counts = renderer.render(uploaded, camera, replace(settings, **changes))["count"]
        return Drawn(int(counts.sum(dtype=np.int64)), int(np.count_nonzero(counts)))

    without, filtered = count(prefilter="none"), count(prefilter="min")
    hits = count(prefilter="none", epsilon=FAR).fragments
    drawn = {"none": without, "min": filtered}.get(settings.prefilter) or count()
    return Fragments(drawn, without, filtered, hits)


def measure(
    renderer: Renderer, rows: Sequence[Row], frames: int, scan: Splats | None, say: Callable[[str], None]
) -> tuple[list[Result], list[Skipped]]:
    """Measure all rows; the rows of one size take turns.

    Parameters
    ----------
    renderer : Renderer
    rows : sequence of Row
        Configurations; those of one size are consecutive.
    frames : int
        Number of samples of each row; slow rows get fewer.
    scan : Splats, optional
        Splats of the model "scan"; its rows are skipped without them.
    say : callable
        Function that receives a line of text after each size.
    """
    results: list[Result] = []
    skipped: list[Skipped] = []
    for size, group in groupby(rows, lambda row: row.num_splats):
        wanted, scenes, jobs = list(group), Scenes(renderer, size, scan), []
        with stage(f"Measuring {size_name(size)} splats", total=len(wanted) * (frames + 1)) as advance:
            for outcome in _prepare(renderer, scenes, wanted, scan is not None):
                advance(1)
                jobs.append(outcome) if isinstance(outcome, Job) else skipped.append(outcome)
            times = turn_by_turn([job.times for job in jobs], frames, SECONDS_PER_ROW * len(jobs), advance)
        results += [job.result(one) for job, one in zip(jobs, times, strict=True)]
        say(f"measured {size_name(size)} splats: {len(jobs)} configurations")
    return results, skipped


def _prepare(renderer: Renderer, scenes: Scenes, rows: Sequence[Row], has_scan: bool) -> Iterator[Job | Skipped]:
    """Yield a job for each row, or the reason why it is skipped."""
    import pyopencl as cl

    for row in rows:
        if row.model == "scan" and not has_scan:
            yield Skipped(row, "there is no scan; give --model FILE, or run from a checkout")
            continue
        if row.num_bytes > MEMORY_SHARE * (free := free_memory()):
            yield Skipped(
                row, f"needs about {row.num_bytes / 2**30:.1f} GiB of memory, but {free / 2**30:.1f} are free"
            )
            continue
        try:
            job = Job(renderer, scenes.uploaded(row), row)
        except (DeviceError, MemoryError, cl.Error) as error:
            yield Skipped(row, str(error) or "out of memory")
            continue
        seconds = seconds_of(job.frame)
        yield job if seconds < MAX_FRAME_SECONDS else Skipped(row, f"one frame took {seconds:.0f} s")


def free_memory() -> float:
    """Return the number of bytes that can be allocated without swapping; inf if unknown."""
    meminfo = Path("/proc/meminfo")
    if not meminfo.exists():
        return float("inf")
    fields = dict(line.split(":", 1) for line in meminfo.read_text().splitlines())
    return 1024.0 * int(fields["MemAvailable"].split()[0])
