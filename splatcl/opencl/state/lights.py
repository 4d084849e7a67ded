"""Lights as kernel arguments: structs in eye space, and the build options for shadows and the light map."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from splatcl.opencl.state.context import PassContext
from splatcl.scene.camera import Camera, rotated
from splatcl.scene.lights import Light
from splatcl.scene.settings import RenderSettings

LIGHTMAP_SIZE = 129
"""Samples of the light map per axis."""
SHADOWED = ("phong", "npr", "user")
"""Shaders that evaluate each light by itself, and so can apply its shadow map."""
MAX_CONE_SLOPE = 1e30
"""Slope of a spot's falloff, per unit of cosine, when its inner and outer angles are equal."""


def shading_structs(context: PassContext) -> tuple[Any, Any]:
    """Return the Shading and PhongLight structs on the device: (1,) and (num_lights,), at least one."""
    settings, lights = context.settings, context.settings.lights
    shading = np.zeros(1, context.dtypes["Shading"])
    for name in ("ambient", "diffuse", "specular", "shininess"):
        shading[name] = getattr(settings.material, name)
    shading["num_lights"] = len(lights)
    eye_lights = np.zeros(max(len(lights), 1), context.dtypes["PhongLight"])
    num_maps = 0
    for struct, light in zip(eye_lights, lights, strict=False):
        has_map = light.shadow != "none"
        for name, value in eye_light(light, context.camera).items():
            struct[name] = value
        struct["map"] = num_maps if has_map else -1
        num_maps += has_map
    return context.constant(shading), context.constant(eye_lights)


def eye_light(light: Light, camera: Camera) -> dict[str, float]:
    """Return the fields of PhongLight, in eye space.

    x, y, z is a position if is_point is 1, else the unit direction toward the light.
    """
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
        struct |= {"cos_outer": outer, "cone": 1 / max(inner - outer, 1 / MAX_CONE_SLOPE)}
    return struct


def light_options(settings: RenderSettings) -> dict[str, int]:
    """Return a shading kernel's build options for the light map or the shadows."""
    if settings.shader == "lightmap":
        return {"LIGHTMAP": LIGHTMAP_SIZE}
    casts = settings.shader in SHADOWED and any(light.shadow != "none" for light in settings.lights)
    return {"SHADOWS": 1} if casts else {}
