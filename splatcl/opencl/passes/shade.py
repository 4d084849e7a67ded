"""The shading pass on the device: from the attribute pass' sums or from AOVs to colours, once per pixel."""

from __future__ import annotations

from typing import Any

import numpy as np

from splatcl.errors import SettingsError, SplatclError
from splatcl.opencl.passes import user_shader
from splatcl.opencl.passes.lightmap import lightmap
from splatcl.opencl.state.buffers import NO_CHANNELS, Channels, DepthBuffer, GBuffer, Shadows, Surface
from splatcl.opencl.state.context import PassContext
from splatcl.opencl.state.lights import light_options, shading_structs
from splatcl.opencl.state.upload import GLOSS

CONTOUR = 4
"""Epsilons of a jump in depth that is a contour, where the settings leave that open."""


def shade(
    context: PassContext,
    view: Any,
    depth: DepthBuffer,
    gbuffer: GBuffer,
    epsilon: float,
    channels: Channels = NO_CHANNELS,
    shadows: Shadows | None = None,
) -> Any:
    """Return the (H, W, 4) linear RGBA buffer, shaded once per pixel (kernels/shade.cl, user.cl)."""
    if context.settings.shader == "user":
        resolved = resolve(context, view, depth, gbuffer)
        surface = Surface(resolved["P"], resolved["N"], resolved["albedo"], gbuffer.weight_sum, channels)
        return shade_surface(context, view, surface, epsilon, shadows)
    return _shade(context, view, _sums(depth, gbuffer), epsilon, channels, shadows, RESOLVED=0)


def shade_surface(
    context: PassContext, view: Any, surface: Surface, epsilon: float, shadows: Shadows | None = None
) -> Any:
    """Return what `shade` does, from AOVs."""
    images = surface.position, surface.normal, surface.albedo, surface.weight
    if context.settings.shader != "user":
        return _shade(context, view, images, epsilon, surface.channels, shadows, RESOLVED=1)
    color = context.image(4)
    structs = shading_structs(context)
    arguments = view, *structs, context.settings.time, *images
    user_shader.run(context, surface.channels, light_arguments(context, structs, shadows), *arguments, color=color)
    return color


def _shade(
    context: PassContext,
    view: Any,
    images: tuple[Any, ...],
    epsilon: float,
    channels: Channels,
    shadows: Shadows | None,
    **options: int,
) -> Any:
    """Run the kernel; specular and shininess of the splats' own stand for the material's."""
    if context.settings.shader == "lightmap" and "shininess" in channels:
        raise SettingsError("shader='lightmap' is made for one shininess: leave the splats' attribute shininess out")
    color = context.image(4)
    has = sum(1 << k for k, name in enumerate(GLOSS) if name in channels)
    gloss = next((channels[name][0] for name in GLOSS if name in channels), images[0])  # not read where there is none
    structs = shading_structs(context)
    npr = _npr(context, epsilon) if context.settings.shader == "npr" else structs  # which others do not read
    arguments = (*structs, *npr, *images, gloss, color, *light_arguments(context, structs, shadows))
    _run_shade(context, "shade", view, *arguments, GLOSS=has, **options)
    return color


def _npr(context: PassContext, epsilon: float) -> tuple[Any, Any]:
    """Return the settings of the npr shader as a struct on the device, and its tones."""
    settings, struct = context.settings.npr, np.zeros(1, context.dtypes["Npr"])
    struct["contour"] = CONTOUR * epsilon if settings.contour == "auto" else settings.contour
    struct["silhouette"], struct["num_tones"] = settings.silhouette, len(settings.tones)
    struct["red"], struct["green"], struct["blue"] = settings.line
    return context.constant(struct), context.constant(np.array(settings.tones, context.real))


def resolve(context: PassContext, view: Any, depth: DepthBuffer, gbuffer: GBuffer) -> dict[str, Any]:
    """Return buffers of what the sums say of the surface: P, N, albedo, depth.mean, depth.distance."""
    surface = {"P": 3, "N": 3, "albedo": 3, "depth.mean": 1, "depth.distance": 1}
    buffers = {name: context.image(channels) for name, channels in surface.items()}
    _run_shade(context, "shade_resolve", view, *_sums(depth, gbuffer), *buffers.values(), RESOLVED=0)
    return buffers


def _run_shade(context: PassContext, kernel: str, *args: Any, **options: int) -> None:
    size = (-(-context.camera.width // context.lanes), context.camera.height)
    settings = context.settings
    # A user's shader has a file of its own; what is not deferred was lit before it was blended.
    shader = "albedo" if settings.shader == "user" or settings.shading != "deferred" else settings.shader
    options = {"GLOSS": 0, **light_options(settings), **options}
    context.run(kernel, size, *args, SHADER=f'"shading/shaders/{shader}.h"', **options)


def _sums(depth: DepthBuffer, gbuffer: GBuffer) -> tuple[Any, ...]:
    return depth.depth, gbuffer.weight_sum, gbuffer.color_sum, gbuffer.normal_sum, gbuffer.depth_sum


def light_arguments(context: PassContext, structs: tuple[Any, Any], shadows: Shadows | None = None) -> tuple[Any, ...]:
    """Return what a kernel that shades takes besides, last (surface.h), built with `light_options`.

    `structs` are those of `shading_structs`, `shadows` those of `shadows.cast`; `SplatclError` where these are missing.
    """
    options = light_options(context.settings)
    if "LIGHTMAP" in options:
        return (lightmap(context, structs),)
    if "SHADOWS" in options:
        if shadows is None:
            raise SplatclError(
                "shadows are cast by splats, which are not at hand here: render again, or take lights with "
                "shadow='none'"
            )
        return shadows.maps, shadows.depths
    return ()
