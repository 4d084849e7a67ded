"""Shade a frame again, from its AOVs alone: no splats, no raster passes."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from splatcl.scene.camera import Camera
from splatcl.errors import SettingsError, SplatclError
from splatcl.opencl.state.lights import light_options
from splatcl.opencl.state.context import PassContext
from splatcl.opencl.session import UploadedSplats
from splatcl.renderer import Renderer, default_renderer
from splatcl.opencl.state.upload import GLOSS, channel_names
from splatcl.scene.settings import RenderSettings
from splatcl.opencl.passes.shade import shade_surface
from splatcl.opencl.state.buffers import Channels, Surface
from splatcl.opencl.passes.shadow import cast
from splatcl.scene.splats import PREFIX

if TYPE_CHECKING:
    from splatcl.frame import Frame

SURFACE = ("P", "N", "albedo")
"""AOVs, (H, W, 3), that shading needs."""
SHADING = ("shader", "user_shader", "user_shader_name", "lights", "material", "npr", "time")
"""Settings that shading takes; the others say how the AOVs came to be."""


def relight(
    frame: Frame, settings: RenderSettings | None, changes: Mapping[str, Any], renderer: Renderer | None = None
) -> Frame:
    """Return `frame` with another "color"; see `Frame.shade`."""
    wanted = _settings(frame, settings, changes)
    epsilon = frame.metadata.get("epsilon")
    if wanted.shader == "npr" and wanted.npr.contour == "auto" and epsilon is None:
        raise SettingsError(
            "npr.contour='auto' is four times a render's epsilon, which this frame has not: give a number"
        )
    surface, attributes = _surface(frame), _attributes(frame, wanted)
    if renderer is None:
        renderer = frame.rendered_from[0] if frame.rendered_from else default_renderer()
    arguments = surface, attributes, frame.camera, wanted, float(epsilon or 0.0)
    casts = "SHADOWS" in light_options(wanted)
    casters = renderer.resident(frame.rendered_from[1]) if frame.rendered_from and casts else None
    color, metadata = renderer.call(_shade, *arguments, casters)
    return frame.with_color(color, wanted, metadata)


def _settings(frame: Frame, settings: RenderSettings | None, changes: Mapping[str, Any]) -> RenderSettings:
    """Return the frame's settings with another shading, or refuse what shading cannot do."""
    own = frame.settings
    if own.shading != "deferred":
        each = "fragment" if own.shading == "fragment" else "splat"
        raise SplatclError(
            f"cannot shade this frame again: shading={own.shading!r} lit each {each} before it was blended"
        )
    if own.supersampling > 1:
        raise SplatclError(
            f"cannot shade this frame again: supersampling={own.supersampling} averaged its surface; render it again"
        )
    if unknown := set(changes) - {field.name for field in fields(RenderSettings)}:
        raise SettingsError(f"no setting {', '.join(sorted(unknown))}; shading takes {', '.join(SHADING)}")
    wanted, plain = own if settings is None else settings, RenderSettings()
    if changes.get("shader", "user") != "user":
        changes = {"user_shader": "", **changes}
    wanted = replace(wanted, **changes)
    for field in fields(RenderSettings):
        value, kept = getattr(wanted, field.name), getattr(own, field.name)
        if field.name not in SHADING and value not in (kept, getattr(plain, field.name)):
            raise SettingsError(f"{field.name}={value!r} needs a new render: this frame was made with {kept!r}")
    return replace(own, **{name: getattr(wanted, name) for name in SHADING})


def _surface(frame: Frame) -> dict[str, NDArray[Any]]:
    """Return P, N, albedo and a weight, above 0 where there is a surface."""
    missing = [name for name in SURFACE if name not in frame]
    if missing:
        raise SplatclError(f"shading needs the AOVs P, N and albedo; this frame has no {' and no '.join(missing)}")
    surface = {name: np.asarray(frame[name]) for name in SURFACE}
    if "weight" in frame:
        surface["weight"] = np.asarray(frame["weight"])
    elif "color" in frame:
        surface["weight"] = np.asarray(frame.color)[..., 3]
    else:
        surface["weight"] = (surface["N"] != 0).any(axis=-1)
    for name, values in surface.items():
        _check_shape(name, values, (frame.height, frame.width, *((3,) if name in SURFACE else ())))
    return surface


def _attributes(frame: Frame, settings: RenderSettings) -> dict[str, NDArray[Any]]:
    """Return the AOVs attribute.NAME by NAME: all for a user's shader, what Phong takes for others."""
    names = [name.removeprefix(PREFIX) for name in frame if name.startswith(PREFIX)]
    found = {name: np.asarray(frame[PREFIX + name]) for name in names if name in GLOSS or settings.shader == "user"}
    for name, values in found.items():
        if not re.fullmatch(r"[A-Za-z_]\w*", name, re.ASCII):
            raise SplatclError(f"AOV {PREFIX}{name} cannot be a field of s.attribute: use letters, digits and _")
        _check_shape(PREFIX + name, values, (frame.height, frame.width))
    return found


def _check_shape(name: str, values: NDArray[Any], shape: tuple[int, ...]) -> None:
    if values.shape != shape or values.dtype.kind not in "fiub":
        raise SplatclError(f"AOV {name} is {values.dtype} of shape {values.shape}; shading needs numbers of {shape}")


def _shade(
    renderer: Renderer,
    surface: Mapping[str, NDArray[Any]],
    attributes: Mapping[str, NDArray[Any]],
    camera: Camera,
    settings: RenderSettings,
    epsilon: float,
    casters: UploadedSplats | None,
) -> tuple[NDArray[Any], dict[str, Any]]:
    """Return the (H, W, 4) colors, and what the frame shall record of them. For `Renderer.call`.

    `casters` are the splats that cast shadows, for lights that have any.
    """
    passes, shadows = renderer.passes(camera, settings), None
    metadata: dict[str, Any] = {}
    if casters and (shadows := cast(renderer, casters, camera, settings, epsilon)):
        metadata["shadow_bias"] = shadows.bias
    images = {name: passes.constant(np.asarray(values, passes.real)) for name, values in surface.items()}
    lit = Surface(images["P"], images["N"], images["albedo"], images["weight"])
    color = shade_surface(passes, passes.view(np.zeros(3)), lit, epsilon, _channels(passes, attributes), shadows)
    if inexact := passes.device.strictness.reason(settings.precision):
        metadata["inexact"] = inexact
    return passes.device.read(color, (camera.height, camera.width, 4), passes.real), metadata


def _channels(passes: PassContext, attributes: Mapping[str, NDArray[Any]]) -> Channels:
    """Put the attributes on the device three by three, specular and shininess first, as the attribute pass does."""
    names = channel_names(attributes)
    places: dict[str, tuple[Any, int]] = {}
    for start in range(0, len(names), 3):
        group = names[start : start + 3]
        image = np.zeros((passes.camera.height, passes.camera.width, 3), passes.real)
        for k, name in enumerate(group):
            image[..., k] = attributes[name] if name else 0
        buffer = passes.constant(image)
        places |= {name: (buffer, k) for k, name in enumerate(group) if name}
    return places
