"""Shadow maps: one visibility pass from each light that casts shadows (docs/guide/lights.md)."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splatcl.errors import SettingsError
from splatcl.opencl.passes.bin import bin
from splatcl.opencl.passes.visibility import project_and_find_depth
from splatcl.opencl.state.buffers import DepthBuffer, Shadows
from splatcl.opencl.state.context import PassContext
from splatcl.opencl.state.upload import DeviceSplats
from splatcl.scene.camera import Camera, rotated
from splatcl.scene.lights import Light
from splatcl.scene.settings import RenderSettings

Sphere = tuple[NDArray[np.float64], float]
"""Center (3,), world space, and radius of a bounding sphere, scene units."""
SPHERE_MARGIN = 1.01
"""Radius that a map covers, in radii of the bounding sphere; above 1 so that rounding cuts nothing off."""
LEAST_NEAR = 1e-3
"""Least near plane of a map, in radii of the bounding sphere; for spots within the sphere."""
MAP_ALIGNMENT = 4096
"""Alignment of each map's start in the buffer, bytes; devices require 128 to 4096."""


def shadow(context: PassContext, splats: DeviceSplats, sphere: Sphere, epsilon: float) -> Shadows:
    """Draw the shadow maps of a frame's lights.

    Parameters
    ----------
    context : PassContext
        Context of the frame.
    splats : DeviceSplats
        The casters.
    sphere : (3,) float64 array and float
        Center and radius of the casters' bounding sphere, world space, scene units.
    epsilon : float
        Depth tolerance, scene units; it sets the biases that are "auto".

    Raises
    ------
    SettingsError
        A point light that casts shadows is within the sphere.
    """
    lights = context.settings.lights
    cameras = {i: light_camera(light, sphere) for i, light in enumerate(lights) if light.shadow != "none"}
    biases = {i: shadow_bias(lights[i], seen_by, sphere, epsilon) for i, seen_by in cameras.items()}
    real_bytes, starts = context.real.itemsize, [0]
    for seen_by in cameras.values():
        pages = -(-(seen_by.width**2) * real_bytes // MAP_ALIGNMENT)
        starts.append(starts[-1] + pages * MAP_ALIGNMENT)
    depths = context.device.buffer(starts[-1])
    structs = np.zeros(len(cameras), context.dtypes["ShadowMap"])
    for struct, start, (i, seen_by) in zip(structs, starts, cameras.items(), strict=False):
        own_depths = depths.get_sub_region(start, seen_by.width**2 * real_bytes)
        _draw(context, seen_by, splats, own_depths)
        for name, value in _map_fields(context.camera, seen_by, lights[i]).items():
            struct[name] = value
        struct["bias"], struct["first"] = biases[i], start // real_bytes
    return Shadows(context.constant(structs), depths, tuple(biases.get(i) for i in range(len(lights))))


def light_camera(light: Light, sphere: Sphere) -> Camera:
    """Return the camera of a light's shadow map.

    A directional light's is orthographic and encloses the sphere. A point light's is perspective and encloses the
    sphere; a spot's encloses the cone.
    """
    (center, radius), size = sphere, int(light.map_size)
    radius = SPHERE_MARGIN * (radius or 1.0)
    vector = np.array(light.vector, np.float64)
    if light.kind == "directional":
        matrix = _look_along(-vector, center)
        focal = size / (2 * radius)
        return Camera(matrix, focal, focal, size / 2, size / 2, size, size, near=-radius, projection="orthographic")
    toward = center - vector
    distance = _length(toward)
    if light.kind == "spot":
        toward, half = np.array(light.direction, np.float64), math.radians(light.outer)
    elif distance > SPHERE_MARGIN * radius:
        half = math.asin(radius / distance)
    else:
        raise SettingsError(
            f"the point light at {light.vector} cannot cast shadows within the splats' bounding sphere (center "
            f"{', '.join(f'{x:.6g}' for x in center)}, radius {sphere[1]:.6g}), where one shadow map does not see all "
            "splats; move it out, or use spot lights"
        )
    focal = size / (2 * math.tan(half))
    near = max(distance - radius, LEAST_NEAR * radius)
    return Camera(_look_along(toward, vector), focal, focal, size / 2, size / 2, size, size, near=near)


def shadow_bias(light: Light, camera: Camera, sphere: Sphere, epsilon: float) -> float:
    """Return the light's bias, scene units; "auto" is two epsilons plus two texels.

    In perspective, a texel is measured at the sphere's center, or a radius from the light if that is farther.
    """
    if light.bias != "auto":
        return float(light.bias)
    texel = 1 / camera.fx
    if camera.projection == "perspective":
        texel *= max(_length(sphere[0] - light.vector), sphere[1])
    return 2 * epsilon + 2 * texel


def _length(vector: NDArray[np.float64]) -> float:
    x, y, z = vector
    return math.sqrt(x * x + y * y + z * z)


def _look_along(forward: NDArray[np.float64], position: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return eye_from_world (4, 4) of an eye at `position` that looks along `forward`.

    It uses no matrix product of NumPy's, so every machine gets the same bits (`rotated`).
    """
    z = forward / np.sqrt((forward * forward).sum())
    aside = np.zeros(3)
    aside[int(np.argmin(np.abs(z)))] = 1.0
    x = np.cross(aside, z)
    x /= np.sqrt((x * x).sum())
    matrix = np.eye(4)
    matrix[:3, :3] = x, np.cross(z, x), z
    matrix[:3, 3] = -rotated(matrix[:3, :3], position)
    return matrix


def _draw(context: PassContext, camera: Camera, splats: DeviceSplats, depths: Any) -> None:
    """Fill `depths`, (size, size) real, with the depth of the nearest disc that the light's camera sees."""
    settings = map_settings(context.settings)
    seen = PassContext(context.device, camera, settings, context.tile_size, context.precision)
    view, depth = seen.view(splats.origin), DepthBuffer(depths, context.device.buffer(camera.width**2 * 4))
    for lists in bin(seen, view, splats):
        project_and_find_depth(seen, view, splats, lists, depth, 0.0)


def map_settings(settings: RenderSettings) -> RenderSettings:
    """Return the settings of a shadow map: the same discs, both sides, without pre-filter and shading."""
    return replace(settings, facing="keep", prefilter="none", normals="constant", lights=(), supersampling=1)


def _map_fields(eye: Camera, camera: Camera, light: Light) -> dict[str, float]:
    """Return fields of ShadowMap: the transform from eye space to the light's space, and the map's raster."""
    rotation, translation = eye.eye_from_world[:3, :3], eye.eye_from_world[:3, 3]
    columns = np.stack([np.cross(rotation[i - 2], rotation[i - 1]) for i in range(3)], axis=1)
    inverse = columns / rotated(rotation, columns[:, 0])[0]
    light_rotation, light_translation = camera.eye_from_world[:3, :3], camera.eye_from_world[:3, 3]
    light_from_eye = np.stack([rotated(light_rotation, inverse[:, k]) for k in range(3)], axis=1)
    offset = light_translation - rotated(light_from_eye, translation)
    return {
        **{f"r{i}{j}": light_from_eye[i, j] for i in range(3) for j in range(3)},
        **{f"t{i}": offset[i] for i in range(3)},
        "focal": camera.fx,
        "middle": camera.cx,
        "near": camera.near,
        "perspective": camera.projection == "perspective",
        "filtered": light.shadow == "pcf",
        "size": camera.width,
    }
