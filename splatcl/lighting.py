"""Lights as the kernels take them: structs in eye space, and what comes with shadows or a light map."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from splatcl.camera import Camera
from splatcl.errors import SplatclError
from splatcl.lights import Light
from splatcl.passes import Passes, rotated
from splatcl.settings import RenderSettings

LIGHTMAP_SIZE = 129
"""Samples of the light map each way."""
LIT = ("phong", "npr", "user")
"""Shaders that ask for each light, and so for its shadows."""
STEP = 1e30
"""Slope of a cone whose edge has no width."""


@dataclass(frozen=True)
class Shadows:
    """The shadow maps of a frame: their structs and all their depths on the device, and each light's bias."""

    maps: Any
    depths: Any
    bias: tuple[float | None, ...]


def shading_structs(passes: Passes) -> tuple[Any, Any]:
    """Return the Shading and PhongLight structs on the device."""
    settings, lights = passes.settings, passes.settings.lights
    shading = np.zeros(1, passes.dtypes["Shading"])
    for name in ("ambient", "diffuse", "specular", "shininess"):
        shading[name] = getattr(settings.material, name)
    shading["num_lights"] = len(lights)
    eye_lights = np.zeros(max(len(lights), 1), passes.dtypes["PhongLight"])
    num_maps = 0
    for struct, light in zip(eye_lights, lights, strict=False):
        has_map = light.shadow != "none"
        for name, value in eye_light(light, passes.camera).items():
            struct[name] = value
        struct["map"] = num_maps if has_map else -1
        num_maps += has_map
    return passes.constant(shading), passes.constant(eye_lights)


def eye_light(light: Light, camera: Camera) -> dict[str, float]:
    """Return fields of PhongLight: a position (is_point 1) or the direction toward the light, in eye space."""
    rotation, vector = camera.eye_from_world[:3, :3], np.array(light.vector, np.float64)
    is_point, eye = light.has_place, np.zeros(3)
    if light.kind == "headlight":
        is_point = camera.projection == "perspective"
        eye[2] = 0.0 if is_point else -1.0
    elif light.has_place:
        eye = rotated(rotation, vector) + camera.eye_from_world[:3, 3]
    else:
        eye = rotated(rotation, vector / np.sqrt((vector * vector).sum()))
    struct = dict(zip(("x", "y", "z", "is_point", "red", "green", "blue"), (*eye, is_point, *light.color), strict=True))
    if light.kind == "spot":
        direction = np.array(light.direction, np.float64)
        back = rotated(rotation, -direction / np.sqrt((direction * direction).sum()))
        struct |= dict(zip(("back_x", "back_y", "back_z"), back, strict=True))
        inner, outer = (math.cos(math.radians(angle)) for angle in (light.inner, light.outer))
        struct |= {"cos_outer": outer, "cone": 1 / max(inner - outer, 1 / STEP)}
    return struct


def light_arguments(passes: Passes, structs: tuple[Any, Any], shadows: Shadows | None = None) -> tuple[Any, ...]:
    """Return what a kernel that shades takes besides, last (surface.h), built with `light_options`.

    `structs` are those of `shading_structs`, `shadows` those of `shadows.cast`; `SplatclError` where these are missing.
    """
    options = light_options(passes.settings)
    if "LIGHTMAP" in options:
        return (lightmap(passes, structs),)
    if "SHADOWS" in options:
        if shadows is None:
            raise SplatclError(
                "shadows are cast by splats, which are not at hand here: render again, or take lights with "
                "shadow='none'"
            )
        return shadows.maps, shadows.depths
    return ()


def light_options(settings: RenderSettings) -> dict[str, int]:
    """Return the build options of a kernel that shades that say what light there is."""
    if settings.shader == "lightmap":
        return {"LIGHTMAP": LIGHTMAP_SIZE}
    casts = settings.shader in LIT and any(light.shadow != "none" for light in settings.lights)
    return {"SHADOWS": 1} if casts else {}


def lightmap(passes: Passes, structs: tuple[Any, Any]) -> Any:
    """Return the light map on the device, (LIGHTMAP_SIZE, LIGHTMAP_SIZE, 6) reals (kernels/passes/lightmap.cl)."""
    table = passes.device.buffer(LIGHTMAP_SIZE**2 * 6 * passes.real.itemsize)
    size = (-(-LIGHTMAP_SIZE // passes.lanes), LIGHTMAP_SIZE)
    passes.run("lightmap", size, *structs, table, LIGHTMAP=LIGHTMAP_SIZE)
    return table
