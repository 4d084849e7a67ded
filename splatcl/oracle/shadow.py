"""Shadow maps: a visibility pass from each light, and lookups in it (docs/guide/lights.md)."""

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
    """Light that reaches points, and how near the comparisons are to flipping; arrays are (...)."""

    share: Array  # fraction of the light, 0 ... 1
    gap: Array  # least |map + bias - z| over the texels read, scene units; +inf beyond the map
    edge: Array  # distance to the edge of the texel read, texels; +inf for a filtered map, which is continuous
    margin: Array  # least margin of the depths of the texels read


def lookup(shadow_map: ShadowMap, position: Array, camera: Camera) -> Lookup:
    """Look up eye-space points (..., 3) of `camera`: lit by a texel iff z <= map + bias.

    A filtered map takes the bilinear mean of the four nearest texels' answers (percentage closer filtering).
    """
    rotation, translation = camera.eye_from_world[:3, :3], camera.eye_from_world[:3, 3]
    light = shadow_map.camera
    world = (position - translation) @ np.linalg.inv(rotation).T
    raster, z = light.project(world)
    raster[z < light.near] = -9.0  # outside the map: points before its near plane are lit
    if not shadow_map.filtered:
        texel = np.floor(raster)
        inside = (raster - texel).min(axis=-1), (1 + texel - raster).min(axis=-1)
        share, gap, margin = _compare(shadow_map, texel, z)
        return Lookup(share, gap, np.minimum(*inside), margin)
    first = np.floor(raster - 0.5)
    f, g = np.moveaxis(raster - 0.5 - first, -1, 0)
    share, gap, margin = np.zeros(z.shape), np.full(z.shape, np.inf), np.full(z.shape, np.inf)
    for step, weight in (((0, 0), (1 - f) * (1 - g)), ((1, 0), f * (1 - g)), ((0, 1), (1 - f) * g), ((1, 1), f * g)):
        lit, own_gap, own_margin = _compare(shadow_map, first + np.array(step), z)
        share += weight * lit
        gap, margin = np.minimum(gap, own_gap), np.minimum(margin, own_margin)
    return Lookup(share, gap, np.full(z.shape, np.inf), margin)


def _compare(shadow_map: ShadowMap, texel: Array, z: Array) -> tuple[Array, Array, Array]:
    """Return 1 where z <= map + bias or the texel is outside the map, else 0; then gap and margin as in `Lookup`.

    `texel` (..., 2) holds column and row as whole floats, z (...) is in scene units along the light's z.
    """
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
    """Draw the shadow map of each light, None for a light without shadows.

    `epsilon`, scene units, is the depth tolerance; a light's bias="auto" is twice this plus two texels.
    """
    return [
        _shadow_map(light, splats, settings, epsilon) if light.shadow != "none" else None for light in settings.lights
    ]


def _shadow_map(light: Light, splats: Splats, settings: RenderSettings, epsilon: float) -> ShadowMap:
    """Run the visibility pass from the light, with all splats kept and no pre-filter."""
    center, radius = splats.bounding_sphere
    camera = _light_camera(light, center, radius)
    seen = replace(settings, facing="keep", prefilter="none", normals="constant", lights=())
    depth = visibility(project(splats, camera, seen), camera, seen)
    distance = 1.0 if light.kind == "directional" else max(float(np.linalg.norm(center - light.vector)), radius)
    bias = 2 * epsilon + 2 * distance / camera.fx if light.bias == "auto" else light.bias
    return ShadowMap(camera, depth, bias, light.shadow == "pcf")


def _light_camera(light: Light, center: Array, radius: float) -> Camera:
    """Return the light's view: of the bounding sphere enlarged by 1 %, or of a spot's cone.

    `center` (3,) and `radius` are the sphere's, in world space and scene units. The view is orthographic for a
    directional light.
    """
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
    """Return eye_from_world (4, 4): z is forward, x = a x z with a the world axis along which z is least."""
    z = normalize(forward)
    x = normalize(np.cross(np.eye(3)[np.abs(z).argmin()], z))
    rotation = np.stack([x, np.cross(z, x), z])
    return np.block([[rotation, -(rotation @ position)[:, None]], [np.zeros(3), 1.0]])
