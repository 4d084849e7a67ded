"""The shading pass on the device: from the attribute pass' sums or from AOVs to colours, once per pixel."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from splatcl import user_shader
from splatcl.camera import Camera
from splatcl.lights import Light
from splatcl.passes import Passes, rotated
from splatcl.resident import GLOSS

if TYPE_CHECKING:
    from splatcl.pipeline import DepthBuffer, GBuffer

CONTOUR = 4
"""Epsilons of a jump in depth that is a contour, where the settings leave that open."""


Channels = Mapping[str, tuple[Any, int]]
"""By a splat attribute's name: a (H, W, 3) image, and which of its channels holds the blended attribute."""
NO_CHANNELS: Channels = MappingProxyType({})


@dataclass(frozen=True)
class Surface:
    """AOVs to shade: P, N and albedo (H, W, 3), and a weight (H, W) above 0 where there is a surface."""

    position: Any
    normal: Any
    albedo: Any
    weight: Any


def shade(
    passes: Passes, view: Any, depth: DepthBuffer, gbuffer: GBuffer, epsilon: float, channels: Channels = NO_CHANNELS
) -> Any:
    """Return the (H, W, 4) linear RGBA buffer, shaded once per pixel (kernels/shade.cl, user.cl)."""
    if passes.settings.shader == "user":
        resolved = resolve(passes, view, depth, gbuffer)
        surface = Surface(resolved["P"], resolved["N"], resolved["albedo"], gbuffer.weight_sum)
        return shade_surface(passes, view, surface, epsilon, channels)
    return _shade(passes, view, _sums(depth, gbuffer), epsilon, channels, RESOLVED=0)


def shade_surface(passes: Passes, view: Any, surface: Surface, epsilon: float, channels: Channels = NO_CHANNELS) -> Any:
    """Return what `shade` does, from AOVs."""
    images = surface.position, surface.normal, surface.albedo, surface.weight
    if passes.settings.shader != "user":
        return _shade(passes, view, images, epsilon, channels, RESOLVED=1)
    color = passes.image(4)
    arguments = view, *shading_structs(passes), passes.settings.time, *images
    user_shader.run(passes, channels, *arguments, color=color)
    return color


def _shade(
    passes: Passes, view: Any, images: tuple[Any, ...], epsilon: float, channels: Channels, **options: int
) -> Any:
    """Run the kernel; specular and shininess of the splats' own stand for the material's."""
    color = passes.image(4)
    has = sum(1 << k for k, name in enumerate(GLOSS) if name in channels)
    gloss = next((channels[name][0] for name in GLOSS if name in channels), images[0])  # not read where there is none
    arguments = (*shading_structs(passes), *_npr(passes, epsilon), *images, gloss, color)
    _run_shade(passes, "shade", view, *arguments, GLOSS=has, **options)
    return color


def shading_structs(passes: Passes) -> tuple[Any, Any]:
    """Return the Shading and PhongLight structs on the device."""
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
    shader = passes.settings.shader
    if (
        shader == "user" or passes.settings.shading != "deferred"
    ):  # has a file of its own; was lit before it was blended
        shader = "albedo"
    passes.run(kernel, size, *args, SHADER=f'"{shader}.h"', **{"GLOSS": 0, **options})


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
