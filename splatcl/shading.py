"""The shading pass on the device: from the attribute pass' sums or from AOVs to colours, once per pixel."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from splatcl import user_shader
from splatcl.camera import Camera
from splatcl.lights import Light
from splatcl.passes import Passes, rotated

if TYPE_CHECKING:
    from splatcl.pipeline import DepthBuffer, GBuffer

CONTOUR = 4
"""Epsilons of a jump in depth that is a contour, where the settings leave that open."""


@dataclass(frozen=True)
class Surface:
    """AOVs to shade: P, N and albedo (H, W, 3), a weight (H, W) above 0 where there is a surface.

    `attributes` holds (num, H, W) of what a user's shader finds by `names` besides.
    """

    position: Any
    normal: Any
    albedo: Any
    weight: Any
    attributes: Any = None
    names: tuple[str, ...] = ()


def shade(passes: Passes, view: Any, depth: DepthBuffer, gbuffer: GBuffer, epsilon: float) -> Any:
    """Return the (H, W, 4) linear RGBA buffer, shaded once per pixel (kernels/shade.cl, user.cl)."""
    if passes.settings.shader == "user":
        resolved = resolve(passes, view, depth, gbuffer)
        surface = Surface(resolved["P"], resolved["N"], resolved["albedo"], gbuffer.weight_sum)
        return shade_surface(passes, view, surface, epsilon)
    color = passes.image(4)
    arguments = (*_shading(passes), *_npr(passes, epsilon), *_sums(depth, gbuffer), color)
    _run_shade(passes, "shade", view, *arguments, RESOLVED=0)
    return color


def shade_surface(passes: Passes, view: Any, surface: Surface, epsilon: float) -> Any:
    """Return what `shade` does, from AOVs."""
    color, settings = passes.image(4), passes.settings
    images = surface.position, surface.normal, surface.albedo, surface.weight
    if settings.shader == "user":
        attributes = surface.attributes or surface.weight  # not read where there are none
        user_shader.run(passes, surface.names, view, *_shading(passes), settings.time, *images, attributes, color)
    else:
        _run_shade(passes, "shade", view, *_shading(passes), *_npr(passes, epsilon), *images, color, RESOLVED=1)
    return color


def _shading(passes: Passes) -> tuple[Any, Any]:
    """Return the material and the lights as structs on the device."""
    settings, lights = passes.settings, passes.settings.lights
    shading = np.zeros(1, passes.dtypes["Shading"])
    for name in ("ambient", "diffuse", "specular", "shininess"):
        shading[name] = getattr(settings.material, name)
    shading["num_lights"] = len(lights)
    eye_lights = [_eye_light(light, passes.camera) for light in lights or (Light(),)]
    return passes.constant(shading), passes.constant(np.array(eye_lights, passes.dtypes["PhongLight"]))


def _npr(passes: Passes, epsilon: float) -> tuple[Any, Any]:
    """Return the settings of the npr shader as a struct on the device, and its tones."""
    settings, struct = passes.settings.npr, np.zeros(1, passes.dtypes["Npr"])
    struct["contour"] = CONTOUR * epsilon if settings.contour == "auto" else settings.contour
    struct["silhouette"], struct["num_tones"] = settings.silhouette, len(settings.tones)
    struct["red"], struct["green"], struct["blue"] = settings.line
    return passes.constant(struct), passes.constant(np.array(settings.tones, passes.real))


def resolve(passes: Passes, view: Any, depth: DepthBuffer, gbuffer: GBuffer) -> dict[str, Any]:
    """Return buffers of what the sums say of the surface: P, N, albedo, depth.mean, depth.distance."""
    surface = {"P": 3, "N": 3, "albedo": 3, "depth.mean": 1, "depth.distance": 1}
    buffers = {name: passes.image(channels) for name, channels in surface.items()}
    _run_shade(passes, "resolve", view, *_sums(depth, gbuffer), *buffers.values(), RESOLVED=0)
    return buffers


def _run_shade(passes: Passes, kernel: str, *args: Any, **options: int) -> None:
    size = (-(-passes.camera.width // passes.lanes), passes.camera.height)
    shader = {"user": "albedo"}.get(passes.settings.shader, passes.settings.shader)  # a user's is not in shade.cl
    passes.run(kernel, size, *args, SHADER=f'"{shader}.h"', **options)


def _sums(depth: DepthBuffer, gbuffer: GBuffer) -> tuple[Any, ...]:
    return depth.depth, gbuffer.weight_sum, gbuffer.color_sum, gbuffer.normal_sum, gbuffer.depth_sum


def _eye_light(light: Light, camera: Camera) -> tuple[float, ...]:
    """Fields of PhongLight: a position (is_point 1) or the direction toward the light, in eye space."""
    rotation, vector = camera.eye_from_world[:3, :3], np.array(light.vector, np.float64)
    if light.kind == "headlight":
        is_point, eye = camera.projection == "perspective", np.zeros(3)
        eye[2] = 0.0 if is_point else -1.0
    elif light.kind == "point":
        is_point, eye = True, rotated(rotation, vector) + camera.eye_from_world[:3, 3]
    else:
        is_point, eye = False, rotated(rotation, vector / np.sqrt((vector * vector).sum()))
    return (*eye, float(is_point), *light.color)
