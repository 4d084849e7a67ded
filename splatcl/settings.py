"""RenderSettings: every choice of the specification that changes what an image means."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Any, Literal, get_args, get_origin, get_type_hints

from splatcl.errors import SettingsError
from splatcl.lights import Light, Material

Along = Literal["z", "ray"]
Prefilter = Literal["min", "none"]
PrefilterCenter = Literal["projected", "bounds"]
Kernel = Literal["gaussian", "constant", "table"]
KernelLookup = Literal["nearest", "linear"]
Facing = Literal["keep", "flip", "cull"]
Shader = Literal["phong", "albedo", "normal"]
Precision = Literal["single", "double"]

MAX_CUTOFF = 8.0
MAX_TABLE = 4096


@dataclass(frozen=True)
class RenderSettings:
    """How splats become pixels (docs/specification.md). The defaults are the paper's, [BHZK05].

    Parameters
    ----------
    epsilon : float or "auto"
        Depth tolerance of the visibility test, scene units, >= 0; "auto" is the median of max(|t_u|, |t_v|).
    along : {"z", "ray"}
        Epsilon is measured along eye z, or along the viewing ray ([ZRB04]).
    prefilter : {"min", "none"}
        r^2 = min(r3^2, r2^2) ([BHZK05] section 4), or r3^2 alone.
    prefilter_radius : float
        Pixels; at 1, splats are at least 2x2 pixels.
    prefilter_center : {"projected", "bounds"}
        r2 is measured from the projected centre (the paper) or from the centre of the projected bounds.
    cutoff : float
        F_g: w = exp(-cutoff^2 r^2 / 2).
    kernel : {"gaussian", "constant", "table"}
        Weight over r in [0, 1].
    kernel_table : tuple of float
        Samples at r = 0 ... 1 for ``kernel="table"``.
    kernel_lookup : {"nearest", "linear"}
        How the table is read.
    facing : {"keep", "flip", "cull"}
        Normals as given, turned toward the eye, or back faces dropped before the visibility pass. Normals
        without a sign (`Splats.oriented` is False) are turned toward the eye whatever this says.
    shader : {"phong", "albedo", "normal"}
    lights : tuple of Light
    material : Material
    precision : {"single", "double"}
        Arithmetic and sums in float32 or float64.

    Raises
    ------
    SettingsError
        A value is not one of its choices or out of its range.
    """

    epsilon: float | Literal["auto"] = "auto"
    along: Along = "z"
    prefilter: Prefilter = "min"
    prefilter_radius: float = 1.0
    prefilter_center: PrefilterCenter = "projected"
    cutoff: float = 2.0
    kernel: Kernel = "gaussian"
    kernel_table: tuple[float, ...] = ()
    kernel_lookup: KernelLookup = "nearest"
    facing: Facing = "keep"
    shader: Shader = "phong"
    lights: tuple[Light, ...] = (Light(),)
    material: Material = Material()  # noqa: RUF009 - frozen
    precision: Precision = "single"

    def __post_init__(self) -> None:
        _check_choices(self)
        self._set("lights", _tuple_of("lights", self.lights, Light))
        self._set("kernel_table", _tuple_of("kernel_table", self.kernel_table, object))
        if not isinstance(self.material, Material):
            raise SettingsError(f"material {self.material!r} is not a Material")
        for light in self.lights:
            _check_choices(light)
        if self.epsilon != "auto":
            self._set("epsilon", _number("epsilon", self.epsilon, 0.0, math.inf))
        self._set("prefilter_radius", _number("prefilter_radius", self.prefilter_radius, 1e-3, 1e3))
        self._set("cutoff", _number("cutoff", self.cutoff, 0.0, MAX_CUTOFF))
        self._set("kernel_table", tuple(_number("kernel_table", s, 0.0, 1e6) for s in self.kernel_table))
        if (self.kernel == "table") != bool(self.kernel_table):
            raise SettingsError("kernel='table' and kernel_table go together: give both or neither")
        if self.kernel_table and not 2 <= len(self.kernel_table) <= MAX_TABLE:
            raise SettingsError(f"kernel_table has {len(self.kernel_table)} samples; it takes 2 to {MAX_TABLE}")
        for field in fields(Material):
            _number(f"material.{field.name}", getattr(self.material, field.name), 0.0, 1e4)
        for light in self.lights:
            for name in ("vector", "color"):
                values = _tuple_of(f"a light's {name}", getattr(light, name), object)
                if len([_number(f"a light's {name}", value, -1e15, 1e15) for value in values]) != 3:
                    raise SettingsError(f"a light's {name} {values!r} is not three numbers")
            if light.kind == "directional" and not any(light.vector):
                raise SettingsError("a directional light needs a vector that points toward it")

    def _set(self, name: str, value: Any) -> None:
        object.__setattr__(self, name, value)


def _check_choices(settings: Any) -> None:
    for name, hint in get_type_hints(type(settings)).items():
        if get_origin(hint) is Literal and getattr(settings, name) not in get_args(hint):
            choices = ", ".join(get_args(hint))
            raise SettingsError(f"{name} {getattr(settings, name)!r} is not one of {choices}")


def _tuple_of(name: str, values: Any, kind: type) -> tuple[Any, ...]:
    try:
        result = tuple(values)
    except TypeError:
        raise SettingsError(f"{name} {values!r} is not a sequence") from None
    for value in result:
        if not isinstance(value, kind):
            raise SettingsError(f"{name} holds {value!r}, which is not a {kind.__name__}")
    return result


def _number(name: str, value: Any, low: float, high: float) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError):
        raise SettingsError(f"{name} {value!r} is not a number") from None
    if not low <= number <= high:  # NaN too
        raise SettingsError(f"{name} {number} is not between {low} and {high}")
    return number
