"""The shading pass on the device: from the attribute pass' sums or from AOVs to colours, once per pixel."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from splatcl import user_shader
from splatcl.errors import SettingsError
from splatcl.lighting import Shadows, light_arguments, light_options, shading_structs
from splatcl.passes import Passes
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
    passes: Passes,
    view: Any,
    depth: DepthBuffer,
    gbuffer: GBuffer,
    epsilon: float,
    channels: Channels = NO_CHANNELS,
    shadows: Shadows | None = None,
) -> Any:
    """Return the (H, W, 4) linear RGBA buffer, shaded once per pixel (kernels/passes/shade.cl, user_shader.cl)."""
    if passes.settings.shader == "user":
        resolved = resolve(passes, view, depth, gbuffer)
        surface = Surface(resolved["P"], resolved["N"], resolved["albedo"], gbuffer.weight_sum)
        return shade_surface(passes, view, surface, epsilon, channels, shadows)
    return _shade(passes, view, _sums(depth, gbuffer), epsilon, channels, shadows, RESOLVED=0)


def shade_surface(
    passes: Passes,
    view: Any,
    surface: Surface,
    epsilon: float,
    channels: Channels = NO_CHANNELS,
    shadows: Shadows | None = None,
) -> Any:
    """Return what `shade` does, from AOVs."""
    images = surface.position, surface.normal, surface.albedo, surface.weight
    if passes.settings.shader != "user":
        return _shade(passes, view, images, epsilon, channels, shadows, RESOLVED=1)
    color = passes.image(4)
    structs = shading_structs(passes)
    arguments = view, *structs, passes.settings.time, *images
    user_shader.run(passes, channels, light_arguments(passes, structs, shadows), *arguments, color=color)
    return color


def _shade(
    passes: Passes,
    view: Any,
    images: tuple[Any, ...],
    epsilon: float,
    channels: Channels,
    shadows: Shadows | None,
    **options: int,
) -> Any:
    """Run the kernel; specular and shininess of the splats' own stand for the material's."""
    if passes.settings.shader == "lightmap" and "shininess" in channels:
        raise SettingsError("shader='lightmap' is made for one shininess: leave the splats' attribute shininess out")
    color = passes.image(4)
    has = sum(1 << k for k, name in enumerate(GLOSS) if name in channels)
    gloss = next((channels[name][0] for name in GLOSS if name in channels), images[0])  # not read where there is none
    structs = shading_structs(passes)
    npr = _npr(passes, epsilon) if passes.settings.shader == "npr" else structs  # which others do not read
    arguments = (*structs, *npr, *images, gloss, color, *light_arguments(passes, structs, shadows))
    _run_shade(passes, "shade", view, *arguments, GLOSS=has, **options)
    return color


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
    _run_shade(passes, "shade_resolve", view, *_sums(depth, gbuffer), *buffers.values(), RESOLVED=0)
    return buffers


def _run_shade(passes: Passes, kernel: str, *args: Any, **options: int) -> None:
    size = (-(-passes.camera.width // passes.lanes), passes.camera.height)
    settings = passes.settings
    # A user's shader has a file of its own; what is not deferred was lit before it was blended.
    shader = "albedo" if settings.shader == "user" or settings.shading != "deferred" else settings.shader
    options = {"GLOSS": 0, **light_options(settings), **options}
    passes.run(kernel, size, *args, SHADER=f'"shading/shaders/{shader}.h"', **options)


def _sums(depth: DepthBuffer, gbuffer: GBuffer) -> tuple[Any, ...]:
    return depth.depth, gbuffer.weight_sum, gbuffer.color_sum, gbuffer.normal_sum, gbuffer.depth_sum
