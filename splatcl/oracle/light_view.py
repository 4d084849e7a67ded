"""What each light sees of the splats: the maps that shadows are looked up in (docs/guide/lights.md)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from splatcl.oracle.project import project
from splatcl.oracle.raster import visibility
from splatcl.oracle.rays import Array, _normalize
from splatcl.oracle.shadow import ShadowMap, Shadows
from splatcl.scene.camera import Camera
from splatcl.scene.lights import Light
from splatcl.scene.settings import RenderSettings
from splatcl.scene.splats import Splats


def shadow_maps(splats: Splats, settings: RenderSettings, epsilon: float) -> Shadows:
    """Return each light's map, None for one that casts no shadows. `epsilon` is for biases that are "auto"."""
    return [
        _shadow_map(light, splats, settings, epsilon) if light.shadow != "none" else None for light in settings.lights
    ]


def _shadow_map(light: Light, splats: Splats, settings: RenderSettings, epsilon: float) -> ShadowMap:
    center, radius = splats.bounding_sphere
    camera = _light_camera(light, center, radius)
    seen = replace(settings, facing="keep", prefilter="none", normals="constant", lights=())
    depth = visibility(project(splats, camera, seen), camera, seen)
    distance = 1.0 if light.kind == "directional" else max(float(np.linalg.norm(center - light.vector)), radius)
    bias = 2 * epsilon + 2 * distance / camera.fx if light.bias == "auto" else light.bias
    return ShadowMap(camera, depth, bias, light.shadow == "pcf")


def _light_camera(light: Light, center: Array, radius: float) -> Camera:
    """Orthographic around the sphere, 1 % larger; perspective around it; or perspective around a spot's cone."""
    radius, size, place = 1.01 * radius, int(light.map_size), np.array(light.vector, np.float64)
    square = size / 2, size / 2, size, size
    if light.kind == "directional":
        focal = size / 2 / radius
        pose = _pose(-place, center)
        return Camera(pose, focal, focal, *square, near=-radius, projection="orthographic")
    distance = float(np.linalg.norm(center - place))
    near = max(distance - radius, radius / 1000)
    if light.kind == "spot":
        focal = size / 2 / np.tan(np.radians(light.outer))
        return Camera(_pose(np.array(light.direction, np.float64), place), focal, focal, *square, near=near)
    focal = size / 2 / np.tan(np.arcsin(radius / distance))
    return Camera(_pose(center - place, place), focal, focal, *square, near=near)


def _pose(forward: Array, position: Array) -> Array:
    """(4, 4) eye_from_world: z is forward, x is at right angles to the world axis that z is least along."""
    z = _normalize(forward)
    x = _normalize(np.cross(np.eye(3)[np.abs(z).argmin()], z))
    rotation = np.stack([x, np.cross(z, x), z])
    return np.block([[rotation, -(rotation @ position)[:, None]], [np.zeros(3), 1.0]])
