"""The measured configurations: a base for all sizes and facings, then variations of one factor each.

To add a configuration, add a line to `FACTORS`.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal, get_args

from splatcl.errors import SettingsError
from splatcl.scene.lights import Light
from splatcl.scene.settings import METHODS, Facing, RenderSettings, Shader

Model = Literal["sphere", "scan"]
Order = Literal["coherent", "shuffled"]

SIZES = (137_000, 655_000, 1_100_000, 4_000_000, 8_300_000, 14_000_000)
"""Numbers of splats of [BHZK05] Table 1."""
FACTOR_SIZES = (1_100_000, 4_000_000)
"""Numbers of splats at which factors are varied."""
QUICK_SIZES = (20_000, 137_000)
"""Numbers of splats of a quick run."""
MAX_SPLATS = 100_000_000
THREE_LIGHTS = (
    Light(),
    Light("directional", (1.0, 2.0, 3.0), (0.5, 0.4, 0.3)),
    Light("point", (-3.0, 2.0, 1.0), (0.3, 0.4, 0.5)),
)
BYTES_PER_SPLAT = 300
"""Estimate of the memory of a splat: on the device 110 without culling (planes 36, records 48, lists 16 and 8 for each
entry), the rest on the host. The 43 MB of the bands come on top. A tile with over 384k entries needs 112 for each."""
BYTES_PER_PIXEL = 96
"""Estimate of the memory of a pixel."""


@dataclass(frozen=True)
class Row:
    """One configuration. `factor` names the difference from the base; "" is the base itself."""

    num_splats: int
    settings: RenderSettings
    factor: str = ""
    model: Model = "sphere"
    order: Order = "coherent"
    width: int = 512
    height: int = 512

    @property
    def name(self) -> str:
        """Text that `--only` searches, such as "sphere 4M shuffled 512x512 min cull phong shuffled"."""
        s = self.settings
        words = [self.model, size_name(self.num_splats), self.order, f"{self.width}x{self.height}"]
        return " ".join([*words, s.prefilter, s.facing, s.shader, self.factor]).strip()

    @property
    def label(self) -> str:
        """Difference from other rows of the same size: the facing of a base row, else the factor."""
        return self.factor or self.settings.facing

    @property
    def num_bytes(self) -> int:
        """Estimate of the memory of the configuration, bytes."""
        scale = 2 if self.settings.precision == "double" else 1
        return scale * (self.num_splats * BYTES_PER_SPLAT + self.width * self.height * BYTES_PER_PIXEL)


BASE = RenderSettings(facing="cull")
USER_SHADER = "float4 shade(const Surface s, const Scene scene) { return (float4)(s.albedo * -s.normal.z, 1.0f); }"
"""A minimal user shader."""


def _shaded(shader: Shader) -> RenderSettings:
    return replace(BASE, shader=shader, user_shader=USER_SHADER if shader == "user" else "")


FACTORS: tuple[Row, ...] = (
    Row(0, BASE, "shuffled", order="shuffled"),
    Row(0, BASE, "1920x1080", width=1920, height=1080),
    Row(0, replace(BASE, prefilter="none"), "no pre-filter"),
    *(Row(0, _shaded(shader), shader) for shader in get_args(Shader) if shader != BASE.shader),
    Row(0, replace(BASE, lights=THREE_LIGHTS), "3 lights"),
    Row(0, replace(BASE, precision="double"), "double"),
    Row(0, replace(BASE, along="ray"), "epsilon along ray"),
    Row(0, BASE, "scan", model="scan"),
    *(Row(0, RenderSettings(method=method, facing="cull"), method) for method in METHODS if method != BASE.method),
    Row(0, replace(BASE, footprint="conic"), "conic"),
    Row(0, replace(BASE, shading="fragment"), "Phong by fragment"),
    Row(0, replace(BASE, shading="splat"), "Gouraud"),
    Row(0, replace(BASE, target="float16"), "float16"),
    Row(0, replace(BASE, target="unorm8"), "unorm8"),
)
"""Variations of one factor; each is compared with the base row of its size."""


def rows(sizes: Sequence[int]) -> list[Row]:
    """Return all rows; factors are varied at the sizes in `FACTOR_SIZES`, or else at the largest size."""
    factor_sizes = [size for size in sizes if size in FACTOR_SIZES] or [max(sizes)]
    return [row for size in sizes for row in _rows_of(size, size in factor_sizes)]


def _rows_of(size: int, with_factors: bool) -> Iterator[Row]:
    for facing in sorted(get_args(Facing)):  # the base, cull, comes first
        yield Row(size, replace(BASE, facing=facing))
    if with_factors:
        for row in FACTORS:
            yield replace(row, num_splats=size)


def base_of(row: Row) -> Row:
    """Return the base row of the size of `row`."""
    return Row(row.num_splats, BASE)


def only(matrix: Sequence[Row], words: str) -> list[Row]:
    """Return the rows with one of `words` ("cull,keep") in their names, and their base rows.

    Raises
    ------
    SettingsError
        There is no such row.
    """
    wanted = [word.strip() for word in words.lower().split(",")]
    chosen = [row for row in matrix if any(word in row.name.lower() for word in wanted)]
    if not chosen:
        labels = ", ".join(dict.fromkeys(row.label for row in matrix))
        raise SettingsError(f"--only {words!r} matches no configuration; there are {labels}")
    bases = {base_of(row) for row in chosen if row.factor}
    return [row for row in matrix if row in chosen or row in bases]


def parse_sizes(text: str) -> tuple[int, ...]:
    """Parse numbers of splats such as "137k,1.1M"; return them in ascending order.

    Raises
    ------
    SettingsError
        A word is no number of splats, or is out of range.
    """
    sizes = set()
    for word in text.split(","):
        number = re.fullmatch(r"(\d{1,9}(?:\.\d{1,6})?)([kM]?)", word.strip())
        size = round(float(number[1]) * {"": 1, "k": 1e3, "M": 1e6}[number[2]]) if number else 0
        if not 1 <= size <= MAX_SPLATS:
            raise SettingsError(f"--sizes {text!r} must be numbers of splats up to 100M, such as 137k,1.1M")
        sizes.add(size)
    return tuple(sorted(sizes))


def size_name(num: int) -> str:
    """Format a number of splats: 137k or 1.1M."""
    for unit, name in ((1e6, "M"), (1e3, "k")):
        if num >= unit:
            return f"{num / unit:.3g}{name}"
    return str(num)
