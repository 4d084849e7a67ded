"""Shade the AOVs of a frame again, without its splats and raster passes."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splatcl.errors import SettingsError, SplatclError
from splatcl.opencl.passes.shade import shade_surface, shading_metadata
from splatcl.opencl.passes.shadow import shadow
from splatcl.opencl.session import Session, UploadedSplats
from splatcl.opencl.state.buffers import Channels, Surface
from splatcl.opencl.state.context import PassContext
from splatcl.opencl.state.lights import light_options
from splatcl.opencl.state.upload import PHONG_ATTRIBUTES, channel_names
from splatcl.scene.camera import Camera
from splatcl.scene.settings import RenderSettings
from splatcl.scene.splats import PREFIX

Aovs = Mapping[str, NDArray[Any]]
SURFACE = ("P", "N", "albedo")
"""AOVs that shading needs, (H, W, 3)."""
SHADING_SETTINGS = ("shader", "user_shader", "user_shader_name", "lights", "material", "npr", "time")
"""Settings that shading reads; all other settings say how the AOVs were made."""


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
        P and N (eye space) and albedo (linear RGB), (H, W, 3). A pixel has a surface if its weight (H, W) is above 0;
        without weight, the alpha of color decides; without either, a normal other than 0.
    camera : Camera
    settings : RenderSettings
        As `shading_settings` returns them.
    epsilon : float or None
        Depth tolerance of the render, scene units; None if unknown.
    casters : UploadedSplats or None
        The splats that cast shadows.

    Returns
    -------
    color : (H, W, 4) array
        Linear RGBA.
    metadata : dict
        Entries that this shading adds to the frame's metadata.

    Raises
    ------
    SplatclError
        P, N or albedo is missing, or an AOV has the wrong shape.
    SettingsError
        The shader does not compile, or its contour needs the epsilon.
    """
    if settings.shader == "npr" and settings.npr.contour == "auto" and epsilon is None:
        raise SettingsError("npr.contour='auto' needs the render's epsilon, which this frame lacks; give a number")
    inputs = _surface(aovs, camera) | _attributes(aovs, camera, settings)
    casters = casters if "SHADOWS" in light_options(settings) else None
    return session.call(_shade, inputs, camera, settings, float(epsilon or 0.0), casters)


def shading_settings(
    own: RenderSettings, settings: RenderSettings | None, changes: Mapping[str, Any]
) -> RenderSettings:
    """Return a frame's `own` settings with the shading of `settings` and `changes`.

    Raises
    ------
    SplatclError
        The frame's AOVs cannot be shaded again.
    SettingsError
        A change needs a new render, or names no setting.
    """
    if own.shading != "deferred":
        each = "fragment" if own.shading == "fragment" else "splat"
        raise SplatclError(
            f"cannot shade this frame again: shading={own.shading!r} lit each {each} before blending; render it again"
        )
    if own.supersampling > 1:
        raise SplatclError(
            f"cannot shade this frame again: supersampling={own.supersampling} averaged its surface; render it again"
        )
    if unknown := set(changes) - {field.name for field in fields(RenderSettings)}:
        raise SettingsError(f"no setting {', '.join(sorted(unknown))}; shading takes {', '.join(SHADING_SETTINGS)}")
    wanted, plain = own if settings is None else settings, RenderSettings()
    if changes.get("shader", "user") != "user":
        changes = {"user_shader": "", **changes}
    wanted = replace(wanted, **changes)
    for field in fields(RenderSettings):
        value, kept = getattr(wanted, field.name), getattr(own, field.name)
        if field.name not in SHADING_SETTINGS and value not in (kept, getattr(plain, field.name)):
            raise SettingsError(f"{field.name}={value!r} needs a new render: this frame was made with {kept!r}")
    return replace(own, **{name: getattr(wanted, name) for name in SHADING_SETTINGS})


def _surface(aovs: Aovs, camera: Camera) -> dict[str, NDArray[Any]]:
    """Return P, N, albedo and a weight (H, W) that is above 0 where there is a surface."""
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
    """Return the AOVs attribute.NAME: all of them for a user's shader, else only specular and shininess."""
    found = {}
    for aov in aovs:
        name = aov.removeprefix(PREFIX)
        if name == aov or (name not in PHONG_ATTRIBUTES and settings.shader != "user"):
            continue
        if not re.fullmatch(r"[A-Za-z_]\w*", name, re.ASCII):
            raise SplatclError(f"AOV {aov} cannot be a field of s.attribute; use letters, digits and _")
        found[aov] = np.asarray(aovs[aov])
        _check_shape(aov, found[aov], (camera.height, camera.width))
    return found


def _check_shape(name: str, values: NDArray[Any], shape: tuple[int, ...]) -> None:
    if values.shape != shape or values.dtype.kind not in "fiub":
        raise SplatclError(
            f"AOV {name} is {values.dtype} of shape {values.shape}; shading needs numbers of shape {shape}"
        )


def _shade(
    session: Session,
    inputs: Aovs,
    camera: Camera,
    settings: RenderSettings,
    epsilon: float,
    casters: UploadedSplats | None,
) -> tuple[NDArray[Any], dict[str, Any]]:
    """Do the work of `relight`, from checked AOVs. For `Session.call`."""
    context, shadows = session.context(camera, settings), None
    if casters:
        shadows = shadow(*session.pass_inputs(casters, camera, settings), casters.sphere, epsilon)
    p, n, albedo, weight = (context.constant(np.asarray(inputs[aov], context.real)) for aov in (*SURFACE, "weight"))
    surface = Surface(p, n, albedo, weight, _channels(context, inputs))
    color = shade_surface(context, context.view(np.zeros(3)), surface, epsilon, shadows)
    metadata = shading_metadata(context.device, settings, shadows)
    return context.device.read(color, (camera.height, camera.width, 4), context.real), metadata


def _channels(context: PassContext, inputs: Aovs) -> Channels:
    """Upload the attributes as images of three channels, in the order of the attribute pass (`channel_names`)."""
    attributes = {aov.removeprefix(PREFIX): values for aov, values in inputs.items() if aov.startswith(PREFIX)}
    names = channel_names(attributes)
    channels: dict[str, tuple[Any, int]] = {}
    for start in range(0, len(names), 3):
        group = names[start : start + 3]
        image = np.zeros((context.camera.height, context.camera.width, 3), context.real)
        for k, name in enumerate(group):
            image[..., k] = attributes[name] if name else 0
        buffer = context.constant(image)
        channels |= {name: (buffer, k) for k, name in enumerate(group) if name}
    return channels
