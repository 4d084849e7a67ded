"""Explain one pixel of a frame: every splat that touches it or nearly does, and what became of it.

The numbers are the kernels' own, as kernels/evidence/probe.cl calls the functions of the visibility and attribute
passes. The running sums therefore end at the frame's weight, count, Z and particleid, bit for bit. The margin is the
oracle's.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splatcl import oracle
from splatcl.camera import Camera
from splatcl.errors import SplatclError
from splatcl.frame import Frame
from splatcl.probe_pass import ACCEPTED, CUT, EDGE_ON, EXISTS, HIT, MISSED, OUT, REACH, UNSEEN, at_pixel
from splatcl.render import Resident
from splatcl.settings import RenderSettings
from splatcl.table import html_table, text_table
from splatcl.uncertainty import MAX_MARGIN, Pairs, decisions, fragments

Array = NDArray[Any]
Triple = tuple[float, float, float]
BEHIND = "behind depth + epsilon"
EDGE_ON_SPLAT = "edge-on"
CLIPPED = "cut off by a clip line"
FILTER, FOOTPRINT = "pre-filter", "footprint, beside the disc"


@dataclass(frozen=True)
class Sums:
    """Sums over the accepted fragments so far."""

    weight: float
    color: Triple
    normal: Triple  # eye space
    count: int


@dataclass(frozen=True)
class ProbeRow:
    """One splat at the pixel, and the pixel's sums after it."""

    splat: int
    u: float  # disc coordinates where the ray meets the splat's plane
    v: float
    r2d: float  # from the pre-filter's centre, in its radii, or in a footprint's ellipse; inf where there is none
    r3d: float  # sqrt(u^2 + v^2); inf for an edge-on splat
    z: float  # eye z of the fragment, scene units; of the ray's meeting with the plane where there is none
    weight: float  # the fragment's own, accepted or not; 0 where there is none
    verdict: str  # "disc", "pre-filter" or "footprint ...", which accepted it; else why it was not
    margin: float  # how near a decision about it is to flipping, in its own rounding errors (splatcl/oracle)
    sums: Sums

    @property
    def accepted(self) -> bool:
        """Whether it is in the sums."""
        return self.verdict in ("disc", FILTER, FOOTPRINT)


@dataclass(frozen=True)
class Probe:
    """What happened at the pixel (x, y) of a frame; print it, or see it in a notebook."""

    x: int
    y: int
    rows: tuple[ProbeRow, ...]  # in splat order
    depth: float  # depth(p), eye z, scene units; inf where no disc was hit
    particleid: int  # the splat that set it; 0xFFFFFFFF for none
    epsilon: float  # scene units, along eye z or the ray as the settings say
    weight: float
    count: int
    albedo: Triple  # what was blended: lit already where shading is not deferred
    normal: Triple  # unit, eye space
    color: tuple[float, float, float, float]  # linear RGBA
    margin: float  # the least of the rows'

    def __str__(self) -> str:
        lines = [f"pixel ({self.x}, {self.y}): {self._summary()}"]
        if self.rows:
            lines += ["", *text_table(COLUMNS, [_cells(row) for row in self.rows])]
        return "\n".join([*lines, "", *(f"{name:<9} {value}" for name, value in self._result())])

    def _repr_html_(self) -> str:
        result = "<br>".join(f"{name} {value}" for name, value in self._result())
        table = html_table(COLUMNS, [_cells(row) for row in self.rows])
        return f"<p>pixel ({self.x}, {self.y}): {self._summary()}</p>{table}<p>{result}</p>"

    def to_json(self) -> str:
        """Return everything as JSON; null stands for an infinite or undefined number."""
        return json.dumps(_finite(asdict(self)), indent=1, allow_nan=False)

    def _summary(self) -> str:
        return f"{self.count} of {len(self.rows)} splats within {REACH} radii are accepted"

    def _result(self) -> Iterator[tuple[str, str]]:
        by = f" (splat {self.particleid})" if np.isfinite(self.depth) else " (no disc is hit)"
        yield "depth(p)", f"{self.depth:.9g}{by}"
        yield "epsilon", f"{self.epsilon:.9g}"
        yield "weight", f"{self.weight:.9g}"
        yield "albedo", _numbers(self.albedo)
        yield "normal", _numbers(self.normal)
        yield "color", _numbers(self.color)
        yield "margin", _margin_text(self.margin)


SUMS = ("sum", "red", "green", "blue", "nx", "ny", "nz", "count")
COLUMNS = ("splat", "u", "v", "r2D", "r3D", "z", "weight", "margin", *SUMS, "verdict")


def _cells(row: ProbeRow) -> list[str]:
    numbers = (row.u, row.v, row.r2d, row.r3d)
    sums = (row.sums.weight, *row.sums.color, *row.sums.normal)
    return [
        str(row.splat),
        *(f"{value:.4f}" for value in numbers),
        f"{row.z:.7g}",
        f"{row.weight:.5f}",
        _margin_text(row.margin),
        *(f"{value:.4g}" for value in sums),
        str(row.sums.count),
        row.verdict,
    ]


def _margin_text(margin: float) -> str:
    return f">={MAX_MARGIN:g}" if margin >= MAX_MARGIN else f"{margin:.4g}"


def _numbers(values: tuple[float, ...]) -> str:
    return " ".join(f"{value:.6g}" for value in values)


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _finite(inner) for name, inner in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(inner) for inner in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value


def probe(frame: Frame, x: int, y: int) -> Probe:
    """Explain the pixel in column `x` and row `y`; see `Frame.probe`."""
    renderer, splats = frame.origin("probe")
    if not (0 <= x < frame.width and 0 <= y < frame.height):
        raise SplatclError(
            f"pixel ({x}, {y}) is outside the image: x is 0 to {frame.width - 1}, y is 0 to {frame.height - 1}"
        )
    resident = renderer.resident(splats)
    found = renderer.call(at_pixel, resident, frame.camera, frame.settings, (x, y))
    rows = sorted(
        [*_seen_rows(found.seen, frame.settings), *_unseen_rows(found.unseen, found.seen)], key=lambda row: row.splat
    )
    margins = _margins(resident, [row.splat for row in rows], frame.camera, frame.settings, x, y)
    return Probe(
        x,
        y,
        tuple(replace(row, margin=margin) for row, margin in zip(rows, margins, strict=True)),
        found.depth,
        found.particleid,
        resident.epsilon(frame.settings),
        weight=frame["weight"][y, x].item(),
        count=frame["count"][y, x].item(),
        albedo=tuple((frame["albedo"] if "albedo" in frame else frame.color[..., :3])[y, x].tolist()),
        normal=tuple(frame["N"][y, x].tolist()),
        color=tuple(frame.color[y, x].tolist()),
        margin=min(margins, default=MAX_MARGIN),
    )


def _seen_rows(seen: Array, settings: RenderSettings) -> Iterator[ProbeRow]:
    for raw in seen:
        state = int(raw["state"])
        if state & ACCEPTED:
            verdict = "disc" if state & HIT else FILTER
            if settings.footprint != "raycast" and settings.prefilter == "none":
                verdict = FOOTPRINT if verdict == FILTER else verdict
        elif state & EXISTS:
            verdict = BEHIND
        else:
            verdict = (
                EDGE_ON_SPLAT if state & EDGE_ON else UNSEEN if state & OUT else CLIPPED if state & CUT else MISSED
            )
        yield _row(raw, verdict, _sums(raw))


def _unseen_rows(unseen: dict[str, Array], seen: Array) -> Iterator[ProbeRow]:
    """Yield rows of splats that the passes never saw: the sums stay as they are."""
    for reason, rows in unseen.items():
        for raw in rows:
            before = np.searchsorted(seen["id"], raw["id"])
            sums = _sums(seen[before - 1]) if before else Sums(0.0, (0.0,) * 3, (0.0,) * 3, 0)
            verdict = EDGE_ON_SPLAT if raw["state"] & EDGE_ON and reason == MISSED else reason
            yield replace(_row(raw, verdict, sums), weight=0.0)


def _sums(raw: Any) -> Sums:
    color = (raw["red"].item(), raw["green"].item(), raw["blue"].item())
    normal = (raw["normal_x"].item(), raw["normal_y"].item(), raw["normal_z"].item())
    return Sums(raw["weight_sum"].item(), color, normal, raw["count"].item())


def _row(raw: Any, verdict: str, sums: Sums) -> ProbeRow:
    u, v, r2, r3, z, weight = (raw[name].item() for name in ("u", "v", "r2", "r3", "z", "weight"))
    if raw["state"] & EDGE_ON:
        u, v, r3 = math.nan, math.nan, math.inf
    return ProbeRow(raw["id"].item(), u, v, r2, r3, z, weight, verdict, MAX_MARGIN, sums)


def _margins(
    resident: Resident, ids: list[int], camera: Camera, settings: RenderSettings, x: int, y: int
) -> list[float]:
    """Return the oracle's margin of each splat's decisions at the pixel, beside the other splats listed."""
    num = len(ids)
    if not num:
        return []
    settings = replace(settings, circular=False)  # the resident's splats are circles already
    projected = oracle.project(resident.splats.take(ids), camera, settings)
    ray = ((x + 0.5 - camera.cx) / camera.fx, (y + 0.5 - camera.cy) / camera.fy, 1.0)
    one = np.zeros(1, np.int64)
    pairs = Pairs(one, one, np.arange(num), np.zeros(num, np.int64), np.tile(ray, (num, 1)))
    units, _ = decisions(pairs, fragments(pairs, projected, camera, settings, resident.epsilon(settings)))
    return np.minimum(units, MAX_MARGIN).tolist()
