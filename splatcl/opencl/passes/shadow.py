"""Shadow maps: for each light that casts shadows, one visibility pass from where it is (docs/guide/lights.md)."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splatcl.errors import SettingsError
from splatcl.opencl.passes.bin import bin
from splatcl.opencl.passes.visibility import project_and_see
from splatcl.opencl.state.buffers import DepthBuffer, Shadows
from splatcl.opencl.state.context import PassContext
from splatcl.opencl.state.upload import DeviceSplats
from splatcl.scene.camera import Camera, rotated
from splatcl.scene.lights import Light
from splatcl.scene.settings import RenderSettings

Sphere = tuple[NDArray[np.float64], float]
AROUND = 1.01
"""How much larger than the bounding sphere what a map shows is: rounding must cut nothing off."""
NEAREST = 1e-3
"""Nearest depth of a map of a light within the splats, in radii of the bounding sphere."""
ALIGNED = 4096
"""Bytes that a map's start in the buffer is a multiple of; devices ask for 128 to 4096."""


def cast(context: PassContext, splats: DeviceSplats, sphere: Sphere, epsilon: float) -> Shadows:
    """Draw the shadow maps of a frame's lights.

    Parameters
    ----------
    context : PassContext
        The frame's.
    splats : DeviceSplats
        The splats that cast.
    sphere : (3,) float64 array and float
        Center and radius of their bounding sphere, world space, scene units.
    epsilon : float
        Depth tolerance, scene units, for biases that are "auto".

    Raises
    ------
    SettingsError
        A point light is within the sphere.
    """
    lights = context.settings.lights
    cameras = {i: light_camera(light, sphere) for i, light in enumerate(lights) if light.shadow != "none"}
    biases = {i: shadow_bias(lights[i], seen_by, sphere, epsilon) for i, seen_by in cameras.items()}
    real_bytes, starts = context.real.itemsize, [0]
    for seen_by in cameras.values():
        pages = -(-(seen_by.width**2) * real_bytes // ALIGNED)
        starts.append(starts[-1] + pages * ALIGNED)
    depths = context.device.buffer(starts[-1])
    structs = np.zeros(len(cameras), context.dtypes["ShadowMap"])
    for struct, start, (i, seen_by) in zip(structs, starts, cameras.items(), strict=False):
        part = depths.get_sub_region(start, seen_by.width**2 * real_bytes)
        _draw(context, seen_by, splats, part)
        for name, value in _map_fields(context.camera, seen_by, lights[i]).items():
            struct[name] = value
        struct["bias"], struct["first"] = biases[i], start // real_bytes
    return Shadows(context.constant(structs), depths, tuple(biases.get(i) for i in range(len(lights))))


def light_camera(light: Light, sphere: Sphere) -> Camera:
    """Return the camera of a light's shadow map: orthographic or perspective, around the sphere or the cone."""
    (center, radius), size = sphere, int(light.map_size)
    radius = AROUND * (radius or 1.0)
    vector = np.array(light.vector, np.float64)
    if light.kind == "directional":
        matrix = _looking(-vector, center)
        focal = size / (2 * radius)
        return Camera(matrix, focal, focal, size / 2, size / 2, size, size, near=-radius, projection="orthographic")
    toward = center - vector
    distance = _length(toward)
    if light.kind == "spot":
        toward, half = np.array(light.direction, np.float64), math.radians(light.outer)
    elif distance > AROUND * radius:
        half = math.asin(radius / distance)
    else:
        raise SettingsError(
            f"a point light at {light.vector} is within the splats' bounding sphere (centre "
            f"{', '.join(f'{x:.6g}' for x in center)}, radius {sphere[1]:.6g}), where one shadow map cannot look all "
            "around: move it out, or take spot lights"
        )
    focal = size / (2 * math.tan(half))
    near = max(distance - radius, NEAREST * radius)
    return Camera(_looking(toward, vector), focal, focal, size / 2, size / 2, size, size, near=near)


def shadow_bias(light: Light, camera: Camera, sphere: Sphere, epsilon: float) -> float:
    """Return the bias in scene units; "auto" is two epsilons and two texels.

    A texel is as wide as at the sphere's centre, or a radius away where that is farther.
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


def _looking(forward: NDArray[np.float64], position: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return eye_from_world of an eye at `position` that looks along `forward`; by single operations (`rotated`)."""
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
    """Fill `depths` with what a light sees of the splats, of both their sides."""
    settings = map_settings(context.settings)
    seen = PassContext(context.device, camera, settings, context.tile_size, context.precision)
    view, depth = seen.view(splats.origin), DepthBuffer(depths, context.device.buffer(camera.width**2 * 4))
    for lists in bin(seen, view, splats):
        project_and_see(seen, view, splats, lists, depth, 0.0)


def map_settings(settings: RenderSettings) -> RenderSettings:
    """Return the settings that a shadow map is drawn with: the same discs, whichever side they show to the light."""
    return replace(settings, facing="keep", prefilter="none", normals="constant", lights=(), supersampling=1)


def _map_fields(eye: Camera, camera: Camera, light: Light) -> dict[str, float]:
    """Return fields of ShadowMap: from the eye's space to the light's, and the light's raster."""
    rotation, translation = eye.eye_from_world[:3, :3], eye.eye_from_world[:3, 3]
    columns = np.stack([np.cross(rotation[i - 2], rotation[i - 1]) for i in range(3)], axis=1)
    inverse = columns / rotated(rotation, columns[:, 0])[0]
    light_rotation, light_translation = camera.eye_from_world[:3, :3], camera.eye_from_world[:3, 3]
    both = np.stack([rotated(light_rotation, inverse[:, k]) for k in range(3)], axis=1)
    moved = light_translation - rotated(both, translation)
    return {
        **{f"r{i}{j}": both[i, j] for i in range(3) for j in range(3)},
        **{f"t{i}": moved[i] for i in range(3)},
        "focal": camera.fx,
        "middle": camera.cx,
        "near": camera.near,
        "perspective": camera.projection == "perspective",
        "filtered": light.shadow == "pcf",
        "size": camera.width,
    }
