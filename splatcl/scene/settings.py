"""RenderSettings: every choice of the specification that changes the meaning of an image."""

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
Along = Literal["method", "z", "ray"]
EpsilonTest = Literal["inclusive", "strict"]
Prefilter = Literal["method", "min", "none", "ewa"]
PrefilterCenter = Literal["projected", "bounds", "parallelogram"]
FilterDepth = Literal["center", "plane", "front"]
Sprite = Literal["exact", "point"]
Kernel = Literal["gaussian", "constant", "table"]
KernelLookup = Literal["nearest", "linear"]
TableAddressing = Literal["samples", "texture"]
TableOver = Literal["r", "r2"]
Facing = Literal["keep", "flip", "cull"]
Shader = Literal["phong", "lightmap", "npr", "albedo", "normal", "depth", "user"]
Precision = Literal["single", "double"]
Target = Literal["auto", "float32", "float64", "float16", "float16_clamped", "unorm8"]

METHODS: dict[Method, dict[str, Any]] = {
    "botsch05": {},
    "zwicker04": {"footprint": "conic", "prefilter": "ewa", "shading": "splat", "along": "ray"},
    "zwicker01": {"footprint": "affine", "prefilter": "ewa"},
    "botsch04": {"prefilter": "none", "normals": "field", "shading": "fragment"},
    "botsch03": {"footprint": "affine", "circular": True, "prefilter": "none", "shading": "splat"},
}
"""Settings of each paper's system that differ from the default, [BHZK05]."""
DEFAULTS = {
    "footprint": "raycast",
    "circular": False,
    "prefilter": "min",
    "normals": "constant",
    "shading": "deferred",
    "along": "z",
}
POINTWISE = ("phong", "albedo", "normal")
"""Shaders that need one surface point alone, so that they can shade each fragment or splat."""

MAX_CUTOFF = 8.0
MAX_TABLE = 4096
MAX_SUPERSAMPLING = 64


@dataclass(frozen=True)
class RenderSettings:
    """Settings of a render (docs/specification.md). The defaults are those of [BHZK05].

    The constructor applies `method`: ``dataclasses.replace(settings, method=...)`` keeps what an earlier method set.

    Parameters
    ----------
    method : {"botsch05", "zwicker04", "zwicker01", "botsch04", "botsch03"}
        System of a paper (docs/guide/methods.md). It sets footprint, circular, prefilter, normals, shading
        and along where these are not given.
    footprint : {"raycast", "affine", "conic"}
        raycast: a splat covers the pixels whose rays hit its disc [BHZK05]; affine: the ellipse of the projection's
        affine approximation at the center [ZPvBG01]; conic: the ellipse of the projected contour [ZRB04].
    circular : bool
        Replace each disc by a circle with the radius of its longer axis [BK03].
    normals : {"constant", "field"}
        constant: one normal for each splat; field: a normal that varies linearly over the splat [BSK04].
    shading : {"deferred", "fragment", "splat"}
        deferred: light each pixel once; fragment: light each fragment before blending [BSK04]; splat: light each
        splat at its center [BK03, ZRB04].
    epsilon : float or "auto"
        Depth tolerance of the visibility test, scene units, >= 0; auto: the median of max(|t_u|, |t_v|).
    along : {"z", "ray"}
        z: measure epsilon along the eye's z axis; ray: along the viewing ray [ZRB04].
    epsilon_test : {"inclusive", "strict"}
        inclusive: a fragment counts if z <= depth(p) + epsilon; strict: if z < depth(p) + epsilon, as with OpenGL's
        LESS and an offset, so epsilon 0 draws no disc.
    prefilter : {"min", "none", "ewa"}
        min: r^2 = min(r3^2, r2^2) with the distances r3 on the splat and r2 on the screen [BHZK05, section 5];
        none: r3^2 alone; ewa: the Gaussian, convolved with a low-pass Gaussian on the screen [ZPvBG01, ZRB04],
        for the footprints affine and conic.
    prefilter_radius : float
        Radius of the screen filter, pixels; 1 makes every splat at least 2x2 pixels. For ewa: the standard
        deviation of the low-pass Gaussian.
    prefilter_center : {"projected", "bounds", "parallelogram"}
        projected: measure r2 from the projected center of the splat [BHZK05]; bounds: from the center of the
        projected disc's bounds; parallelogram: from the center of the bounds of the projected corners c +- t_u +- t_v.
    filter_depth : {"center", "plane", "front"}
        Depth of a fragment that only the pre-filter "min" accepts. center: the depth of the splat's center; plane:
        where the ray meets the splat's plane; front: depth(p). Where these have no value, the center's.
    sprite : {"exact", "point"}
        exact: draw every pixel of a splat; point: draw those in the square point of [BHZK05, section 3], whose side is
        2 r f_y / c_z, which cuts discs that are near and tilted, or far off the axis.
    cutoff : float
        Radius of the disc in standard deviations of its Gaussian, 0 to 8: the weight is w = exp(-cutoff^2 r^2 / 2).
        The disc keeps its size. [ZRB04]'s F_g keeps the Gaussian and sizes the disc: scale the splats by
        F_g (`Splats.scaled`) and give cutoff = F_g.
    kernel : {"gaussian", "constant", "table"}
        Weight of a fragment as a function of r in [0, 1].
    kernel_table : tuple of float
        2 to 4096 weights over r from 0 to 1, for the kernel table.
    kernel_lookup : {"nearest", "linear"}
        nearest: read the nearest entry of the table; linear: interpolate between two.
    table_addressing : {"samples", "texture"}
        samples: the first entry is at r = 0 and the last at r = 1; texture: the entries are texels, with centers half
        a step inside, and the ends are clamped.
    table_over : {"r", "r2"}
        r: the entries have equal steps of r; r2: of r^2.
    facing : {"keep", "flip", "cull"}
        keep: use the normals as given; flip: turn them toward the eye; cull: drop back faces before the visibility
        pass. Estimated normals have no sign and always turn toward the eye.
    shader : {"phong", "lightmap", "npr", "albedo", "normal", "depth", "user"}
        Color of a pixel (docs/guide/shaders.md has a picture of each).
    user_shader : str
        OpenCL C of the shader "user": a function ``float4 shade(const Surface s, const Scene scene)``.
    user_shader_name : str
        Name of the user's shader in compile errors.
    lights : tuple of Light
        Light sources (docs/guide/lights.md).
    material : Material
        Phong coefficients.
    npr : Npr
        Tones and lines of the shader "npr".
    time : float
        Time for a user's shader, seconds.
    precision : {"single", "double"}
        single: compute in float32; double: compute in float64.
    target : {"auto", "float32", "float64", "float16", "float16_clamped", "unorm8"}
        Format to which weights, colors, normals and attributes are rounded after every product and sum
        [BHZK05, figure 2]; auto: the format of the precision; float16: sums above 65504 become infinite, as on GPUs;
        float16_clamped: they stop at 65504.
    half_inputs : bool
        Round centers and normals to 16-bit floats first [BHZK05, section 6].
    supersampling : int
        Average n x n samples for each pixel, n from 1 to 64 (docs/guide/supersampling.md).

    Raises
    ------
    SettingsError
        A value is out of its range or not one of its choices, or two settings contradict each other.
    """

    epsilon: float | Literal["auto"] = "auto"
    along: Along = "method"
    prefilter: Prefilter = "method"
    prefilter_radius: float = 1.0
    prefilter_center: PrefilterCenter = "projected"
    sprite: Sprite = "exact"
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
    table_addressing: TableAddressing = "samples"
    table_over: TableOver = "r"
    epsilon_test: EpsilonTest = "inclusive"
    filter_depth: FilterDepth = "center"

    def __post_init__(self) -> None:
        for name, default in (DEFAULTS | METHODS.get(self.method, {})).items():
            if getattr(self, name) in ("method", None):
                self._set(name, default)
        _check_choices(self)
        self._set("lights", _tuple_of("lights", self.lights, Light))
        self._set("kernel_table", _tuple_of("kernel_table", self.kernel_table, object))
        if not isinstance(self.material, Material):
            raise SettingsError(f"material {self.material!r} must be a Material")
        if self.epsilon != "auto":
            self._set("epsilon", _number("epsilon", self.epsilon, 0.0, math.inf))
        self._set("prefilter_radius", _number("prefilter_radius", self.prefilter_radius, 1e-3, 1e3))
        self._set("cutoff", _number("cutoff", self.cutoff, 0.0, MAX_CUTOFF))
        self._set("kernel_table", tuple(_number("kernel_table", s, 0.0, 1e6) for s in self.kernel_table))
        if (self.kernel == "table") != bool(self.kernel_table):
            raise SettingsError("kernel='table' and kernel_table need each other; give both or neither")
        if self.kernel_table and not 2 <= len(self.kernel_table) <= MAX_TABLE:
            raise SettingsError(f"kernel_table has {len(self.kernel_table)} weights; give 2 to {MAX_TABLE}")
        for field in fields(Material):
            _number(f"material.{field.name}", getattr(self.material, field.name), 0.0, 1e4)
        for light in self.lights:
            _check_light(light)
        self._check_further()
        self._refuse()

    def _check_further(self) -> None:
        """Check the settings that [BHZK05] does not have."""
        self._set("npr", _checked_npr(self.npr))
        self._set("time", _number("time", self.time, -1e9, 1e9))
        self._set("supersampling", _whole("supersampling", self.supersampling, 1, MAX_SUPERSAMPLING))
        for name in ("circular", "half_inputs"):
            if not isinstance(getattr(self, name), bool):
                raise SettingsError(f"{name} {getattr(self, name)!r} must be True or False")
        for name in ("user_shader", "user_shader_name"):
            if not isinstance(getattr(self, name), str):
                raise SettingsError(f"{name} {getattr(self, name)!r} must be a string")

    def _refuse(self) -> None:
        """Raise `SettingsError` where two settings contradict each other."""
        if self.prefilter == "ewa":
            if self.footprint == "raycast":
                raise SettingsError("prefilter='ewa' needs an ellipse; choose footprint='affine' or 'conic'")
            if self.kernel != "gaussian" or not self.cutoff:
                raise SettingsError("prefilter='ewa' needs a Gaussian; choose kernel='gaussian' and a cutoff above 0")
        if self.sprite == "point" and self.footprint != "raycast":
            raise SettingsError(
                f"sprite='point' cannot be combined with footprint={self.footprint!r}: ellipses have exact bounds; "
                "choose footprint='raycast', or sprite='exact'"
            )
        shadows = any(light.shadow != "none" for light in self.lights)
        if shadows and self.shading != "deferred":
            raise SettingsError(
                f"shading={self.shading!r} cannot have shadows: shadow maps are read once for each pixel; "
                "choose shading='deferred', or shadow='none' for every light"
            )
        if self.shader == "lightmap" and (shadows or any(light.has_place for light in self.lights)):
            raise SettingsError(
                "shader='lightmap' cannot have shadows or lights with a position: it reads light by direction alone; "
                "choose directional lights and headlights with shadow='none', or shader='phong'"
            )
        if self.shading != "deferred" and self.shader not in POINTWISE:
            raise SettingsError(f"shader={self.shader!r} needs whole pixels; choose shading='deferred'")
        if self.shading == "splat" and self.normals == "field":
            raise SettingsError(
                "normals='field' has no effect with shading='splat', which lights the center of a splat alone; "
                "choose normals='constant' or another shading"
            )
        if self.target == "float64" and self.precision == "single":
            raise SettingsError("target='float64' needs precision='double'; choose it, or target='auto'")
        if self.user_shader and self.shader != "user":
            raise SettingsError("user_shader needs shader='user'; choose it, or leave user_shader out")

    def _set(self, name: str, value: Any) -> None:
        object.__setattr__(self, name, value)


def _check_choices(settings: Any) -> None:
    for name, hint in get_type_hints(type(settings)).items():
        if get_origin(hint) is Literal and getattr(settings, name) not in get_args(hint):
            choices = ", ".join(get_args(hint))
            raise SettingsError(f"{name} {getattr(settings, name)!r} must be one of {choices}")


def _check_light(light: Light) -> None:
    _check_choices(light)
    for name in ("vector", "color", "direction"):
        values = _tuple_of(f"a light's {name}", getattr(light, name), object)
        if len([_number(f"a light's {name}", value, -1e15, 1e15) for value in values]) != 3:
            raise SettingsError(f"a light's {name} {values!r} must be three numbers")
    if light.kind == "directional" and not any(light.vector):
        raise SettingsError("a directional light needs a vector; give the direction toward the light")
    if light.kind == "spot" and not any(light.direction):
        raise SettingsError("a spot light needs a direction; give the one in which it shines")
    outer = _number("a light's outer", light.outer, 0.1, 89.0)
    if not _number("a light's inner", light.inner, 0.0, 89.0) <= outer:
        raise SettingsError(f"a light's inner {light.inner} must not exceed its outer {light.outer}, degrees")
    if light.bias != "auto":
        _number("a light's bias", light.bias, 0.0, 1e15)
    _whole("a light's map_size", light.map_size, 16, 8192)
    if light.kind == "headlight" and light.shadow != "none":
        raise SettingsError(
            "a headlight has no visible shadows: it shines from the eye; choose shadow='none' or another kind"
        )


def _checked_npr(npr: Any) -> Npr:
    if not isinstance(npr, Npr):
        raise SettingsError(f"npr {npr!r} must be an Npr")
    tones = tuple(_number("npr.tones", tone, 0.0, 1e4) for tone in _tuple_of("npr.tones", npr.tones, object))
    if not 1 <= len(tones) <= MAX_TABLE:
        raise SettingsError(f"npr.tones has {len(tones)} tones; give 1 to {MAX_TABLE}")
    line = tuple(_number("npr.line", value, 0.0, 1e4) for value in _tuple_of("npr.line", npr.line, object))
    if len(line) != 3:
        raise SettingsError(f"npr.line {line!r} must be three numbers")
    contour = npr.contour if npr.contour == "auto" else _number("npr.contour", npr.contour, 0.0, 1e15)
    return Npr(tones, contour, _number("npr.silhouette", npr.silhouette, -1.0, 1.0), (line[0], line[1], line[2]))


def _tuple_of(name: str, values: Any, kind: type) -> tuple[Any, ...]:
    try:
        result = tuple(values)
    except TypeError:
        raise SettingsError(f"{name} {values!r} must be a sequence") from None
    for value in result:
        if not isinstance(value, kind):
            raise SettingsError(f"{name} must hold a {kind.__name__} each, not {value!r}")
    return result


def _number(name: str, value: Any, low: float, high: float) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError):
        raise SettingsError(f"{name} {value!r} must be a number") from None
    if not low <= number <= high:  # NaN too
        raise SettingsError(f"{name} {number} must be between {low} and {high}")
    return number


def _whole(name: str, value: Any, low: int, high: int) -> int:
    number = _number(name, value, low, high)
    if number != int(number):
        raise SettingsError(f"{name} {number} must be a whole number")
    return int(number)


def effective_settings(settings: RenderSettings, oriented: bool) -> RenderSettings:
    """Return the settings for these splats: normals without a sign turn toward the eye, and no splat is culled."""
    return settings if oriented else replace(settings, facing="flip")
