"""RenderSettings: every choice of the specification that changes what an image means."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from typing import Any, Literal, get_args, get_origin, get_type_hints

from splatcl.errors import SettingsError
from splatcl.scene.lights import Light, Material, Npr

Method = Literal["botsch05", "zwicker04", "zwicker01", "botsch04", "botsch03"]
Footprint = Literal["method", "raycast", "affine", "conic"]
Normals = Literal["method", "constant", "field"]
Shading = Literal["method", "deferred", "fragment", "splat"]
Along = Literal["z", "ray"]
Prefilter = Literal["method", "min", "none", "ewa"]
PrefilterCenter = Literal["projected", "bounds"]
Kernel = Literal["gaussian", "constant", "table"]
KernelLookup = Literal["nearest", "linear"]
Facing = Literal["keep", "flip", "cull"]
Shader = Literal["phong", "lightmap", "npr", "albedo", "normal", "depth", "user"]
Precision = Literal["single", "double"]
Target = Literal["auto", "float32", "float64", "float16", "unorm8"]

METHODS: dict[Method, dict[str, Any]] = {
    "botsch05": {},
    "zwicker04": {"footprint": "conic", "prefilter": "ewa"},
    "zwicker01": {"footprint": "affine", "prefilter": "ewa"},
    "botsch04": {"prefilter": "none", "normals": "field", "shading": "fragment"},
    "botsch03": {"footprint": "affine", "circular": True, "prefilter": "none", "shading": "splat"},
}
"""What each paper's system chooses where it differs from the default, [BHZK05]."""
DEFAULTS = {"footprint": "raycast", "circular": False, "prefilter": "min", "normals": "constant", "shading": "deferred"}
POINTWISE = ("phong", "albedo", "normal")
"""Shaders that need nothing but the place itself, and so may be asked of every fragment or splat."""

MAX_CUTOFF = 8.0
MAX_TABLE = 4096
MAX_SUPERSAMPLING = 64


@dataclass(frozen=True)
class RenderSettings:
    """How splats become pixels (docs/specification.md). The defaults are the paper's, [BHZK05].

    Parameters
    ----------
    method : {"botsch05", "zwicker04", "zwicker01", "botsch04", "botsch03"}
        The paper's system whose choices of `footprint`, `circular`, `prefilter`, `normals` and `shading` are
        taken where those are "method" (None) or not given (docs/guide/methods.md). It is applied when the settings are
        made: ``dataclasses.replace(settings, method=...)`` does not change them again.
    footprint : {"raycast", "affine", "conic"}
        What of the screen a disc covers: the pixels whose rays hit it ([BHZK05]), the ellipse of the projection's
        affine map exact at the centre ([ZPvBG01]), or the ellipse of its projected contour ([ZRB04]).
    circular : bool
        Every disc is taken as the circle about it, as large as its longer axis ([BK03]).
    normals : {"constant", "field"}
        One normal for each splat, or a linear field of them (`Splats.normal_du`; [BSK04]).
    shading : {"deferred", "fragment", "splat"}
        Light each pixel once, each fragment before it is blended ([BSK04]), or each splat ([BK03]).
    epsilon : float or "auto"
        Depth tolerance of the visibility test, scene units, >= 0; "auto" is the median of max(|t_u|, |t_v|).
    along : {"z", "ray"}
        Epsilon is measured along eye z, or along the viewing ray ([ZRB04]).
    prefilter : {"min", "none", "ewa"}
        r^2 = min(r3^2, r2^2) ([BHZK05] section 4), r3^2 alone, or the Gaussian convolved with a low-pass one, for
        footprints that are ellipses ([ZPvBG01], [ZRB04]).
    prefilter_radius : float
        Pixels; at 1, splats are at least 2x2 pixels. Under "ewa" the low-pass filter's standard deviation.
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
    shader : {"phong", "lightmap", "npr", "albedo", "normal", "depth", "user"}
        docs/guide/shaders.md shows each.
    user_shader : str
        OpenCL C of ``shader="user"``: a function ``float4 shade(const Surface s, const Scene scene)``.
    user_shader_name : str
        What compile errors call it.
    lights : tuple of Light
    material : Material
    npr : Npr
    time : float
        Seconds, for a user's shader.
    precision : {"single", "double"}
        Arithmetic in float32 or float64.
    target : {"auto", "float32", "float64", "float16", "unorm8"}
        What weights, colours, normals and attributes are rounded to after every product and sum ([BHZK05] figure 2);
        "auto" is the precision's own.
    half_inputs : bool
        Centres and normals are rounded to 16 bits before anything else ([BHZK05] section 6).
    supersampling : int
        n: render n x n as many pixels and average them (docs/guide/supersampling.md).

    Raises
    ------
    SettingsError
        A value is not one of its choices or out of its range.
    """

    epsilon: float | Literal["auto"] = "auto"
    along: Along = "z"
    prefilter: Prefilter = "method"
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
    method: Method = "botsch05"
    footprint: Footprint = "method"
    circular: bool | None = None
    normals: Normals = "method"
    shading: Shading = "method"
    target: Target = "auto"
    half_inputs: bool = False
    supersampling: int = 1
    npr: Npr = Npr()  # noqa: RUF009 - frozen
    user_shader: str = ""
    user_shader_name: str = "shader.cl"
    time: float = 0.0

    def __post_init__(self) -> None:
        for name, default in (DEFAULTS | METHODS.get(self.method, {})).items():
            if getattr(self, name) in ("method", None):
                self._set(name, default)
        _check_choices(self)
        self._set("lights", _tuple_of("lights", self.lights, Light))
        self._set("kernel_table", _tuple_of("kernel_table", self.kernel_table, object))
        if not isinstance(self.material, Material):
            raise SettingsError(f"material {self.material!r} is not a Material")
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
            _check_light(light)
        self._check_further()
        self._refuse()

    def _check_further(self) -> None:
        """Check what has come with other methods than [BHZK05]'s."""
        self._set("npr", _checked_npr(self.npr))
        self._set("time", _number("time", self.time, -1e9, 1e9))
        self._set("supersampling", _whole("supersampling", self.supersampling, 1, MAX_SUPERSAMPLING))
        for name in ("circular", "half_inputs"):
            if not isinstance(getattr(self, name), bool):
                raise SettingsError(f"{name} {getattr(self, name)!r} is neither True nor False")
        for name in ("user_shader", "user_shader_name"):
            if not isinstance(getattr(self, name), str):
                raise SettingsError(f"{name} {getattr(self, name)!r} is not a text")

    def _refuse(self) -> None:
        """Refuse what has no meaning together."""
        if self.prefilter == "ewa":
            if self.footprint == "raycast":
                raise SettingsError("prefilter='ewa' convolves ellipses: choose footprint='affine' or 'conic'")
            if self.kernel != "gaussian" or not self.cutoff:
                raise SettingsError(
                    "prefilter='ewa' convolves Gaussians: choose kernel='gaussian' and a cutoff above 0"
                )
        shadows = any(light.shadow != "none" for light in self.lights)
        if shadows and self.shading != "deferred":
            raise SettingsError(
                f"shadow maps are looked up once per pixel, which shading={self.shading!r} does not light: "
                "choose shading='deferred', or shadow='none' for every light"
            )
        if self.shader == "lightmap" and (shadows or any(light.has_place for light in self.lights)):
            raise SettingsError(
                "shader='lightmap' looks light up by direction alone, and so knows no light's position and no shadow: "
                "choose directional lights and headlights with shadow='none', or shader='phong'"
            )
        if self.shading != "deferred" and self.shader not in POINTWISE:
            raise SettingsError(f"shader={self.shader!r} looks at whole pixels: choose shading='deferred'")
        if self.shading == "splat" and self.normals == "field":
            raise SettingsError("normals='field' has no effect where shading='splat' takes each splat's centre alone")
        if self.target == "float64" and self.precision == "single":
            raise SettingsError("target='float64' needs precision='double'")
        if self.user_shader and self.shader != "user":
            raise SettingsError("user_shader needs shader='user'")

    def _set(self, name: str, value: Any) -> None:
        object.__setattr__(self, name, value)


def _check_choices(settings: Any) -> None:
    for name, hint in get_type_hints(type(settings)).items():
        if get_origin(hint) is Literal and getattr(settings, name) not in get_args(hint):
            choices = ", ".join(get_args(hint))
            raise SettingsError(f"{name} {getattr(settings, name)!r} is not one of {choices}")


def _check_light(light: Light) -> None:
    _check_choices(light)
    for name in ("vector", "color", "direction"):
        values = _tuple_of(f"a light's {name}", getattr(light, name), object)
        if len([_number(f"a light's {name}", value, -1e15, 1e15) for value in values]) != 3:
            raise SettingsError(f"a light's {name} {values!r} is not three numbers")
    if light.kind == "directional" and not any(light.vector):
        raise SettingsError("a directional light needs a vector that points toward it")
    if light.kind == "spot" and not any(light.direction):
        raise SettingsError("a spot light needs a direction in which it shines")
    outer = _number("a light's outer", light.outer, 0.1, 89.0)
    if not _number("a light's inner", light.inner, 0.0, 89.0) <= outer:
        raise SettingsError(f"a light's inner {light.inner} is wider than its outer {light.outer}: both are degrees")
    if light.bias != "auto":
        _number("a light's bias", light.bias, 0.0, 1e15)
    _whole("a light's map_size", light.map_size, 16, 8192)
    if light.kind == "headlight" and light.shadow != "none":
        raise SettingsError(
            "a headlight shines from the eye, which sees none of its shadows: choose shadow='none' or another kind"
        )


def _checked_npr(npr: Any) -> Npr:
    if not isinstance(npr, Npr):
        raise SettingsError(f"npr {npr!r} is not an Npr")
    tones = tuple(_number("npr.tones", tone, 0.0, 1e4) for tone in _tuple_of("npr.tones", npr.tones, object))
    if not 1 <= len(tones) <= MAX_TABLE:
        raise SettingsError(f"npr.tones has {len(tones)} tones; it takes 1 to {MAX_TABLE}")
    line = tuple(_number("npr.line", value, 0.0, 1e4) for value in _tuple_of("npr.line", npr.line, object))
    if len(line) != 3:
        raise SettingsError(f"npr.line {line!r} is not three numbers")
    contour = npr.contour if npr.contour == "auto" else _number("npr.contour", npr.contour, 0.0, 1e15)
    return Npr(tones, contour, _number("npr.silhouette", npr.silhouette, -1.0, 1.0), (line[0], line[1], line[2]))


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


def _whole(name: str, value: Any, low: int, high: int) -> int:
    number = _number(name, value, low, high)
    if number != int(number):
        raise SettingsError(f"{name} {number} is not a whole number")
    return int(number)


def effective_settings(settings: RenderSettings, oriented: bool) -> RenderSettings:
    """Return the settings for splats whose normals may have no sign: they are turned toward the eye, none is culled."""
    return settings if oriented else replace(settings, facing="flip")
