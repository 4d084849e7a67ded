"""Shadows: whether points are behind what a light sees of the splats (docs/lights.md)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from splatcl.oracle.buffers import Array, ShadowMap, Shadows
from splatcl.oracle.geometry.rays import normalize
from splatcl.oracle.project import project
from splatcl.oracle.visibility import visibility
from splatcl.scene.camera import Camera
from splatcl.scene.lights import Light
from splatcl.scene.settings import RenderSettings
from splatcl.scene.splats import Splats


@dataclass(frozen=True, eq=False)
class Lookup:
    """How much of a light reaches points, and how near that is to being decided otherwise; all (...)."""

    share: Array  # 0 ... 1
    gap: Array  # scene units: least distance of z from map + bias, over the texels asked; +inf beyond the map
    edge: Array  # texels: how far the point is from where other texels are asked; +inf where that is continuous
    margin: Array  # least margin of those texels' depths


def lookup(shadow_map: ShadowMap, position: Array, camera: Camera) -> Lookup:
    """Ask the map of points (..., 3) in the eye space of `camera`."""
    rotation, translation = camera.eye_from_world[:3, :3], camera.eye_from_world[:3, 3]
    light = shadow_map.camera
    world = (position - translation) @ np.linalg.inv(rotation).T
    raster, z = light.project(world)
    raster[z < light.near] = -9.0  # nothing in front of the map is shaded
    if not shadow_map.filtered:
        texel = np.floor(raster)
        inside = (raster - texel).min(axis=-1), (1 + texel - raster).min(axis=-1)
        share, gap, margin = _asked(shadow_map, texel, z)
        return Lookup(share, gap, np.minimum(*inside), margin)
    first = np.floor(raster - 0.5)
    f, g = np.moveaxis(raster - 0.5 - first, -1, 0)
    share, gap, margin = np.zeros(z.shape), np.full(z.shape, np.inf), np.full(z.shape, np.inf)
    for step, weight in (((0, 0), (1 - f) * (1 - g)), ((1, 0), f * (1 - g)), ((0, 1), (1 - f) * g), ((1, 1), f * g)):
        lit, own_gap, own_margin = _asked(shadow_map, first + np.array(step), z)
        share += weight * lit
        gap, margin = np.minimum(gap, own_gap), np.minimum(margin, own_margin)
    return Lookup(share, gap, np.full(z.shape, np.inf), margin)


def _asked(shadow_map: ShadowMap, texel: Array, z: Array) -> tuple[Array, Array, Array]:
    """(...) 1 where z <= map + bias or there is no such texel, else 0; the gap between them; the map's margin."""
    size = shadow_map.camera.width
    inside = np.asarray(np.minimum(texel, size - 1 - texel).min(axis=-1) >= 0)
    column, row = np.moveaxis(np.where(inside[..., None], texel, 0).astype(int), -1, 0)
    slack = np.where(inside, shadow_map.depth.depth[row, column] + shadow_map.bias - z, np.inf)
    return (
        (slack >= 0).astype(float),
        np.abs(slack),
        np.where(inside, shadow_map.depth.depth_margin[row, column], np.inf),
    )


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
    z = normalize(forward)
    x = normalize(np.cross(np.eye(3)[np.abs(z).argmin()], z))
    rotation = np.stack([x, np.cross(z, x), z])
    return np.block([[rotation, -(rotation @ position)[:, None]], [np.zeros(3), 1.0]])
