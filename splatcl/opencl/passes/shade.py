"""The shading pass on the device: colors from the attribute pass' sums or from AOVs, once per pixel.

The kernels are in kernels/passes/shade.cl; a user's shader runs in kernels/passes/user_shader.cl.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from splatcl.errors import SettingsError, SplatclError
from splatcl.opencl.device.strictness import Device
from splatcl.opencl.passes.lightmap import lightmap
from splatcl.opencl.passes.user_shader import user_shader
from splatcl.opencl.state.buffers import Channels, Raster, Shadows, Surface
from splatcl.opencl.state.context import PassContext, shader_header
from splatcl.opencl.state.lights import light_options, shading_structs
from splatcl.opencl.state.upload import PHONG_ATTRIBUTES
from splatcl.scene.settings import RenderSettings

CONTOUR = 4
"""Least jump in depth at a contour for npr.contour="auto", in epsilons."""


def shade(context: PassContext, raster: Raster, shadows: Shadows | None = None) -> Any:
    """Return the shaded image as a buffer, (H, W, 4) real linear RGBA."""
    if context.settings.shader == "user":
        resolved = resolve(context, raster)
        weight = raster.gbuffer.weight_sum
        surface = Surface(resolved["P"], resolved["N"], resolved["albedo"], weight, raster.channels)
        return shade_surface(context, raster.view, surface, raster.epsilon, shadows)
    return _shade(context, raster.view, _sums(raster), raster.epsilon, raster.channels, shadows, RESOLVED=0)


def shade_surface(
    context: PassContext, view: Any, surface: Surface, epsilon: float, shadows: Shadows | None = None
) -> Any:
    """Return the shaded image as `shade` does, from AOVs; `epsilon` is the depth tolerance, scene units."""
    images = surface.position, surface.normal, surface.albedo, surface.weight
    if context.settings.shader != "user":
        return _shade(context, view, images, epsilon, surface.channels, shadows, RESOLVED=1)
    color = context.image(4)
    structs = shading_structs(context)
    arguments = view, *structs, context.settings.time, *images
    user_shader(context, surface.channels, light_arguments(context, structs, shadows), *arguments, color=color)
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
    """Run the kernel; the splats' specular and shininess, if any, replace the material's."""
    if context.settings.shader == "lightmap" and "shininess" in channels:
        raise SettingsError(
            "shader='lightmap' has one shininess for all splats; remove the splats' attribute shininess"
        )
    color = context.image(4)
    own = sum(1 << k for k, name in enumerate(PHONG_ATTRIBUTES) if name in channels)  # bit 0 specular, 1 shininess
    # The kernel reads the image of specular and shininess only if GLOSS is set, and the npr structs only for "npr".
    own_image = next((channels[name][0] for name in PHONG_ATTRIBUTES if name in channels), images[0])
    structs = shading_structs(context)
    npr = _npr(context, epsilon) if context.settings.shader == "npr" else structs
    arguments = (*structs, *npr, *images, own_image, color, *light_arguments(context, structs, shadows))
    _run_shade(context, "shade", view, *arguments, GLOSS=own, **options)
    return color


def _npr(context: PassContext, epsilon: float) -> tuple[Any, Any]:
    """Return the npr shader's settings on the device: the Npr struct, (1,), and the tones, (num_tones,) real."""
    settings, struct = context.settings.npr, np.zeros(1, context.dtypes["Npr"])
    struct["contour"] = CONTOUR * epsilon if settings.contour == "auto" else settings.contour
    struct["silhouette"], struct["num_tones"] = settings.silhouette, len(settings.tones)
    struct["red"], struct["green"], struct["blue"] = settings.line
    return context.constant(struct), context.constant(np.array(settings.tones, context.real))


def resolve(context: PassContext, raster: Raster) -> dict[str, Any]:
    """Return buffers of the AOVs that the sums determine: P, N, albedo (H, W, 3), depth.mean, depth.distance (H, W)."""
    surface = {"P": 3, "N": 3, "albedo": 3, "depth.mean": 1, "depth.distance": 1}
    buffers = {name: context.image(channels) for name, channels in surface.items()}
    _run_shade(context, "shade_resolve", raster.view, *_sums(raster), *buffers.values(), RESOLVED=0)
    return buffers


def _run_shade(context: PassContext, kernel: str, *args: Any, **options: int) -> None:
    size = (-(-context.camera.width // context.lanes), context.camera.height)
    settings = context.settings
    # A user's shader runs in its own kernel. Forward shading blends shaded colors, so only albedo remains.
    shader = "albedo" if settings.shader == "user" or settings.shading != "deferred" else settings.shader
    options = {"GLOSS": 0, **light_options(settings), **options}
    context.run(kernel, size, *args, SHADER=shader_header(shader), **options)


def _sums(raster: Raster) -> tuple[Any, ...]:
    gbuffer = raster.gbuffer
    return raster.depth.depth, gbuffer.weight_sum, gbuffer.color_sum, gbuffer.normal_sum, gbuffer.depth_sum


def light_arguments(context: PassContext, structs: tuple[Any, Any], shadows: Shadows | None = None) -> tuple[Any, ...]:
    """Return a shading kernel's last arguments: the light map, the shadow maps, or none (kernels/shading/surface.h).

    The kernel must be built with `light_options`.

    Parameters
    ----------
    context : PassContext
    structs : tuple
        As `shading_structs` returns them.
    shadows : Shadows, optional
        As `shadow.shadow` returns them.

    Raises
    ------
    SplatclError
        The lights cast shadows, but `shadows` is missing.
    """
    options = light_options(context.settings)
    if "LIGHTMAP" in options:
        return (lightmap(context, structs),)
    if "SHADOWS" in options:
        if shadows is None:
            raise SplatclError(
                "cannot cast shadows: this frame has no splats; render it again, or use lights with shadow='none'"
            )
        return shadows.maps, shadows.depths
    return ()


def shading_metadata(device: Device, settings: RenderSettings, shadows: Shadows | None) -> dict[str, Any]:
    """Return the metadata of shading: each light's shadow bias, and the reason if the image may be inexact."""
    metadata: dict[str, Any] = {"shadow_bias": shadows.bias} if shadows else {}
    if inexact := device.strictness.reason(settings.precision):
        metadata["inexact"] = inexact
    return metadata
