"""Account for every splat, list entry, fragment and color of a frame (docs/trust/probe.md).

A second render of the frame's splats, in a constant color, supplies the numbers; they must add up exactly.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splatcl import oracle
from splatcl.evidence.entries import expected_entries, list_faults, project_in_order
from splatcl.opencl.aovs import DeviceAovs
from splatcl.opencl.passes.attributes import attributes, fragment_arguments
from splatcl.opencl.passes.bin import all_splats, bin
from splatcl.opencl.passes.project import project
from splatcl.opencl.passes.visibility import visibility
from splatcl.opencl.session import Session, UploadedSplats
from splatcl.opencl.state.buffers import Band, DepthBuffer, Raster
from splatcl.opencl.state.context import PassContext, frame_buffers, shader_header
from splatcl.opencl.state.upload import DeviceSplats
from splatcl.scene.camera import Camera
from splatcl.scene.settings import RenderSettings, Target
from splatcl.scene.splats import Splats

Array = NDArray[Any]
CONSTANT_COLOR = (1.0, 0.7, 1 / 3)
"""Linear RGB of every splat; red must stay exact, green and blue within the rounding of their sums."""
MAX_SUSPECTS = 100
"""Maximum number of suspect splats that the oracle redraws; the rest count as lost."""
CERTAIN = 32.0
"""Margin from which a float32 renderer must decide as the oracle does, in rounding errors (tests/tolerances.py)."""
SPLATS_PER_BATCH = 1 << 18
"""Most splats that the oracle projects together."""
TARGET_TYPES = {"float16": np.float16, "float16_clamped": np.float16, "float32": np.float32}
ONE_LANE: dict[str, Any] = {"LANES": 1, "SHADING": 0, "FIELD": 0, "CHANNELS": 0, "SHADER": shader_header("albedo")}
"""Build options of a kernel that evaluates one splat at one pixel, and only whether it has a fragment."""
CHUNK = 4096
"""Records whose fragments one work-item counts."""


@dataclass(frozen=True)
class Check:
    """One check, its result, and its numbers."""

    name: str
    passed: bool
    detail: str

    @property
    def verdict(self) -> str:
        """Result and numbers, for the frame's metadata."""
        return f"{'passed' if self.passed else 'FAILED'}: {self.detail}"

    def __str__(self) -> str:
        return f"{self.name:<15} {self.verdict}"


def check(
    session: Session,
    uploaded: UploadedSplats,
    camera: Camera,
    settings: RenderSettings,
    aovs: Mapping[str, Array],
) -> tuple[Check, ...]:
    """Render a frame's splats again and check that everything adds up; see `Frame.check`.

    Parameters
    ----------
    session : Session
    uploaded : UploadedSplats
        Prepared for the settings (`UploadedSplats.prepared`).
    camera, settings
        Those of the frame.
    aovs : mapping of str to array
        AOVs of the first render.
    """
    kept, checks, again = session.call(_account, uploaded, camera, settings)
    checks = [_check_splats(kept, uploaded.splats, camera, settings), *checks]
    differing = [name for name, array in again.items() if array.tobytes() != aovs[name].tobytes()]
    detail = f"{', '.join(differing or again)} {'differ from' if differing else 'have'} the bits of the first render"
    return (*checks, Check("repetition", not differing, detail))


def _account(
    session: Session, uploaded: UploadedSplats, camera: Camera, settings: RenderSettings
) -> tuple[Array, list[Check], dict[str, Array]]:
    """Render in a constant color. For `Session.call`.

    Returns
    -------
    kept : (S,) uint32
        Indices of the splats that the projection keeps, in splat order.
    checks : list of Check
        The checks of binning, fragments and color.
    again : dict of str to array
        The AOVs that do not depend on color.
    """
    settings = replace(settings, shading="deferred", shader="albedo", user_shader="")
    recolored = replace(uploaded.splats, color=np.tile(CONSTANT_COLOR, (len(uploaded.splats), 1)))
    context, on_device = session.pass_inputs(session.upload(recolored), camera, settings)
    view, epsilon = context.view(on_device.origin), uploaded.epsilon(settings)
    kept = project_in_order(context, view, on_device)
    expected = expected_entries(kept, context.tile_size, context.tiles_x)
    depth, gbuffer = frame_buffers(context)
    faults: list[str] = []
    num_listed = 0
    for lists in bin(context, view, on_device):
        projected = project(context, view, on_device, lists)
        faults += list_faults(context, kept, expected, lists, projected)
        num_listed += int(lists.begin[-1])
        visibility(context, lists, projected, depth)
        attributes(context, Band(view, lists, projected, depth, epsilon), gbuffer)
    aovs = DeviceAovs(context, Raster(view, depth, gbuffer, epsilon), None)
    num_fragments = _count_fragments(context, view, on_device, depth, epsilon)
    checks = [
        _check_binning(faults, len(expected.tile), num_listed, context.num_tiles),
        _check_fragments(num_fragments, aovs["count"]),
        _check_color(aovs["albedo"], aovs["weight"], aovs["count"], settings.target),
    ]
    return kept.ids, checks, {name: aovs[name] for name in ("Z", "particleid", "weight", "count")}


# ---- splats: each is drawn, culled, or touches no pixel


def _check_splats(kept: Array, splats: Splats, camera: Camera, settings: RenderSettings) -> Check:
    """Check that no splat is lost: by the oracle too, every splat that is not kept is culled or touches no pixel."""
    num_culled = num_outside = num_lost = 0
    dropped = np.setdiff1d(np.arange(len(splats)), kept)
    for start in range(0, len(dropped), SPLATS_PER_BATCH):
        part = splats.take(dropped[start : start + SPLATS_PER_BATCH])
        projected = oracle.project.project(part, camera, settings)
        first, last = np.ceil(projected.bounds[:, :2] - 0.5), np.floor(projected.bounds[:, 2:] - 0.5)
        size = np.array([camera.width, camera.height])
        touches = (np.maximum(first, 0) <= np.minimum(last, size - 1)).all(axis=1)
        suspects = np.flatnonzero(touches)
        lost = sum(_is_drawn(part.take([i]), camera, settings) for i in suspects[:MAX_SUSPECTS])
        lost += max(len(suspects) - MAX_SUSPECTS, 0)
        culled = int(np.count_nonzero(projected.culled))
        num_culled, num_lost = num_culled + culled, num_lost + lost
        num_outside += len(part) - culled - lost
    increasing = bool((np.diff(kept.astype(np.int64)) > 0).all())
    added_up = len(kept) + num_culled + num_outside + num_lost == len(splats)
    detail = f"{len(kept)} drawn + {num_culled} culled + {num_outside} that touch no pixel = {len(splats)}"
    if splats.num_dropped:
        detail += f", after {splats.num_dropped} invalid splats were dropped"
    if num_lost:
        detail += f", and {num_lost} lost"
    if not increasing:
        detail += "; the drawn splats are not in splat order"
    return Check("splats", increasing and added_up and not num_lost, detail)


def _is_drawn(splat: Splats, camera: Camera, settings: RenderSettings) -> bool:
    """Return True if the oracle draws a single splat at some pixel, with a margin above `CERTAIN`."""
    settings = replace(settings, epsilon_test="inclusive")  # a strict epsilon of 0 would reject every disc
    projected = oracle.project.project(splat, camera, settings)
    depth = oracle.visibility.visibility(projected, camera, settings)
    gbuffer = oracle.attributes.attributes(projected, depth, splat, camera, settings, 0.0)
    margin = np.minimum(depth.margin, gbuffer.margin)
    return bool(((gbuffer.count > 0) & (margin > CERTAIN)).any())


# ---- binning: the list of each tile has every splat whose bounds touch the tile


def _check_binning(faults: list[str], num_expected: int, num_listed: int, num_tiles: int) -> Check:
    detail = f"{num_expected} times a splat touches a tile, all among {num_listed} entries of {num_tiles} lists"
    detail += ", in order"
    return Check("binning", not faults, f"wrong: {'; '.join(faults)}" if faults else detail)


# ---- fragments and color


def _count_fragments(context: PassContext, view: Any, splats: DeviceSplats, depth: DepthBuffer, epsilon: float) -> int:
    """Count the fragments splat by splat, without tiles (kernels/evidence/accounting.cl)."""
    (epsilon, along, _, inverse_radius2, _, _), options = fragment_arguments(context, epsilon)
    total = 0
    for lists in all_splats(context, splats.num_splats):
        projected, num = project(context, view, splats, lists), int(lists.begin[-1])
        num_chunks = -(-num // CHUNK)
        counts = context.device.buffer(num_chunks * 8)
        context.run(
            "accounting", (num_chunks,), view, projected.records, projected.extra, projected.attributes,
            projected.boxes, num, CHUNK, epsilon, along, inverse_radius2, depth.depth, counts,
            **{**projected.options, **options, **ONE_LANE},
        )  # fmt: skip
        total += int(context.device.read(counts, (num_chunks,), np.uint64).sum())
    return total


def _check_fragments(num_fragments: int, count: Array) -> Check:
    total = int(count.sum(dtype=np.uint64))
    detail = f"{total} by pixel {'=' if total == num_fragments else 'but'} {num_fragments} by splat"
    return Check("fragments", total == num_fragments, detail)


def color_bound(count: Array, weight: Array, target: Target = "auto") -> Array:
    """Return the bound of a constant color's relative error after sums of `count` terms.

    To first order it is (2 count + 1) u with u = 2^-24 (double precision: 2^-53). The numerator has `count` roundings
    of products and sums, the denominator count - 1, the quotient one, and the color itself one. Products below the
    normal range lose more; the last term bounds that.
    """
    limits = np.finfo(TARGET_TYPES.get(target, weight.dtype))
    unit = float(limits.eps) / 2
    terms = 2 * count.astype(np.float64) + 1
    return terms * unit / (1 - terms * unit) + count * float(limits.tiny) / weight


def _check_color(albedo: Array, weight: Array, count: Array, target: Target) -> Check:
    if target == "unorm8":
        return Check("constant color", True, "does not apply: unorm8 clamps its sums")
    covered = (weight > 0) & np.isfinite(weight)  # a float16 sum may overflow
    albedo, weight, count = albedo[covered], weight[covered], count[covered]
    exact = np.count_nonzero(albedo[:, 0] != CONSTANT_COLOR[0])
    error = np.abs(albedo[:, 1:].astype(np.float64) / CONSTANT_COLOR[1:] - 1)
    outside = np.count_nonzero(error > color_bound(count, weight, target)[:, None])
    detail = f"1 comes out as 1 at {len(albedo) - exact} of {len(albedo)} pixels"
    detail += f", {CONSTANT_COLOR[1]} and 1/3 to within {error.max(initial=0.0):.1e}"
    if outside:
        detail += f", {outside} times outside the bound"
    return Check("constant color", not exact and not outside, detail)
