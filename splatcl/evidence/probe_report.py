"""The report of a probed pixel, as text, HTML and JSON: a row for each splat that touches or nearly touches it."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from splatcl.evidence.host.pairs import MAX_MARGIN
from splatcl.util.table import html_table, text_table

Triple = tuple[float, float, float]
BEHIND = "behind depth + epsilon"
EDGE_ON_SPLAT = "edge-on"
CLIPPED = "cut off by a clip line"
REACH = 1.25
"""A splat is listed if its disc or pre-filter, enlarged by this factor, covers the pixel."""
FILTER, FOOTPRINT = "pre-filter", "footprint, beside the disc"


@dataclass(frozen=True)
class Sums:
    """Sums over the accepted fragments of the splats so far."""

    weight: float
    color: Triple  # linear RGB
    normal: Triple  # eye space
    count: int


@dataclass(frozen=True)
class ProbeRow:
    """One splat at the pixel, and the pixel's sums after it."""

    splat: int
    u: float  # disc coordinates where the ray meets the splat's plane
    v: float
    r2d: float  # distance from the pre-filter's center in its radii, or r of an elliptical footprint; else inf
    r3d: float  # sqrt(u^2 + v^2); inf for an edge-on splat
    z: float  # eye z of the fragment, scene units; without a fragment, where the ray meets the splat's plane
    weight: float  # of the fragment, whether accepted or not; 0 without a fragment
    verdict: str  # what accepted the splat: "disc", "pre-filter" or "footprint ..."; else why it is not in the sums
    margin: float  # distance of its nearest decision from flipping, in units of that decision's rounding error
    sums: Sums

    @property
    def accepted(self) -> bool:
        """True if the splat is in the sums."""
        return self.verdict in ("disc", FILTER, FOOTPRINT)


@dataclass(frozen=True)
class Probe:
    """Explanation of one pixel of a frame; print it, or show it in a notebook."""

    x: int  # column
    y: int  # row
    rows: tuple[ProbeRow, ...]  # in splat order
    depth: float  # depth(p), eye z, scene units; inf where no disc is hit
    particleid: int  # index of the splat that set it; 0xFFFFFFFF where there is none
    epsilon: float  # scene units, along eye z or the ray as the settings say
    weight: float
    count: int
    albedo: Triple  # linear RGB, blended; shaded already unless shading is deferred
    normal: Triple  # unit, eye space
    color: tuple[float, float, float, float]  # linear RGBA
    margin: float  # least margin of the rows

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
        """Return everything as JSON; an infinite or undefined number becomes null."""
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
