"""Shade AOVs again: no splats, no raster passes."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splatcl.errors import SettingsError, SplatclError
from splatcl.opencl.passes.shade import shade_surface
from splatcl.opencl.passes.shadow import cast
from splatcl.opencl.session import Session, UploadedSplats
from splatcl.opencl.state.buffers import Channels, Surface
from splatcl.opencl.state.context import PassContext
from splatcl.opencl.state.lights import light_options
from splatcl.opencl.state.upload import GLOSS, channel_names
from splatcl.scene.camera import Camera
from splatcl.scene.settings import RenderSettings
from splatcl.scene.splats import PREFIX

Aovs = Mapping[str, NDArray[Any]]
SURFACE = ("P", "N", "albedo")
"""AOVs, (H, W, 3), that shading needs."""
SHADING = ("shader", "user_shader", "user_shader_name", "lights", "material", "npr", "time")
"""Settings that shading takes; all other settings say how the AOVs were made."""


def relight(
    session: Session,
    aovs: Aovs,
    camera: Camera,
    settings: RenderSettings,
    epsilon: float | None,
    casters: UploadedSplats | None,
) -> tuple[NDArray[Any], dict[str, Any]]:
    """Shade a frame's AOVs with other settings.

    Parameters
    ----------
    session : Session
    aovs : mapping of str to array
        P, N and albedo (eye space, (H, W, 3)); weight (H, W) or color say where there is a surface.
    camera : Camera
    settings : RenderSettings
        From `shading_settings`.
    epsilon : float or None
        The render's depth tolerance, scene units; None if it is not known.
    casters : UploadedSplats or None
        The splats that cast shadows.

    Returns
    -------
    color : (H, W, 4) array
        Linear RGBA.
    metadata : dict
        What the frame records of this shading.

    Raises
    ------
    SplatclError
        P, N or albedo is missing, or an AOV has the wrong shape.
    SettingsError
        The shader does not compile, or its contour needs the epsilon.
    """
    if settings.shader == "npr" and settings.npr.contour == "auto" and epsilon is None:
        raise SettingsError("npr.contour='auto' needs the render's epsilon, which this frame lacks; give a number")
    arguments = _surface(aovs, camera), _attributes(aovs, camera, settings), camera, settings, float(epsilon or 0.0)
    return session.call(_shade, *arguments, casters if "SHADOWS" in light_options(settings) else None)


def shading_settings(
    own: RenderSettings, settings: RenderSettings | None, changes: Mapping[str, Any]
) -> RenderSettings:
    """Return a frame's `own` settings with the shading of `settings` and `changes`; refuse any other change."""
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


def _surface(aovs: Aovs, camera: Camera) -> dict[str, NDArray[Any]]:
    """Return P, N, albedo and a weight, above 0 where there is a surface."""
    missing = [name for name in SURFACE if name not in aovs]
    if missing:
        raise SplatclError(f"shading needs the AOVs P, N and albedo; this frame has no {' and no '.join(missing)}")
    surface = {name: np.asarray(aovs[name]) for name in SURFACE}
    if "weight" in aovs:
        surface["weight"] = np.asarray(aovs["weight"])
    elif "color" in aovs:
        surface["weight"] = np.asarray(aovs["color"])[..., 3]
    else:
        surface["weight"] = (surface["N"] != 0).any(axis=-1)
    for name, values in surface.items():
        _check_shape(name, values, (camera.height, camera.width, *((3,) if name in SURFACE else ())))
    return surface


def _attributes(aovs: Aovs, camera: Camera, settings: RenderSettings) -> dict[str, NDArray[Any]]:
    """Return the AOVs attribute.NAME by NAME: every one for a user's shader, only Phong's for any other."""
    names = [name.removeprefix(PREFIX) for name in aovs if name.startswith(PREFIX)]
    found = {name: np.asarray(aovs[PREFIX + name]) for name in names if name in GLOSS or settings.shader == "user"}
    for name, values in found.items():
        if not re.fullmatch(r"[A-Za-z_]\w*", name, re.ASCII):
            raise SplatclError(f"AOV {PREFIX}{name} cannot be a field of s.attribute: use letters, digits and _")
        _check_shape(PREFIX + name, values, (camera.height, camera.width))
    return found


def _check_shape(name: str, values: NDArray[Any], shape: tuple[int, ...]) -> None:
    if values.shape != shape or values.dtype.kind not in "fiub":
        raise SplatclError(f"AOV {name} is {values.dtype} of shape {values.shape}; shading needs numbers of {shape}")


def _shade(
    session: Session,
    surface: Aovs,
    attributes: Aovs,
    camera: Camera,
    settings: RenderSettings,
    epsilon: float,
    casters: UploadedSplats | None,
) -> tuple[NDArray[Any], dict[str, Any]]:
    """Return what `relight` does, from checked AOVs. For `Session.call`."""
    context, shadows = session.context(camera, settings), None
    metadata: dict[str, Any] = {}
    if casters:
        shadows = cast(*session.prepare(casters, camera, settings), casters.sphere, epsilon)
        metadata["shadow_bias"] = shadows.bias
    images = {name: context.constant(np.asarray(values, context.real)) for name, values in surface.items()}
    lit = Surface(images["P"], images["N"], images["albedo"], images["weight"], _channels(context, attributes))
    color = shade_surface(context, context.view(np.zeros(3)), lit, epsilon, shadows)
    if inexact := context.device.strictness.reason(settings.precision):
        metadata["inexact"] = inexact
    return context.device.read(color, (camera.height, camera.width, 4), context.real), metadata


def _channels(context: PassContext, attributes: Aovs) -> Channels:
    """Put the attributes on the device three by three, specular and shininess first, as the attribute pass does."""
    names = channel_names(attributes)
    places: dict[str, tuple[Any, int]] = {}
    for start in range(0, len(names), 3):
        group = names[start : start + 3]
        image = np.zeros((context.camera.height, context.camera.width, 3), context.real)
        for k, name in enumerate(group):
            image[..., k] = attributes[name] if name else 0
        buffer = context.constant(image)
        places |= {name: (buffer, k) for k, name in enumerate(group) if name}
    return places
