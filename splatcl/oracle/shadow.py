"""Shadows: whether points are behind what a light sees of the splats (docs/guide/lights.md)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from splatcl.oracle.rays import Array
from splatcl.scene.camera import Camera

if TYPE_CHECKING:
    from splatcl.oracle.raster import DepthBuffer


@dataclass(frozen=True, eq=False)
class ShadowMap:
    """What one light sees: depth, scene units along its own z."""

    camera: Camera
    depth: DepthBuffer
    bias: float
    filtered: bool


@dataclass(frozen=True, eq=False)
class Lookup:
    """How much of a light reaches points, and how near that is to being decided otherwise; all (...)."""

    share: Array  # 0 ... 1
    gap: Array  # scene units: least distance of z from map + bias, over the texels asked; +inf beyond the map
    edge: Array  # texels: how far the point is from where other texels are asked; +inf where that is continuous
    margin: Array  # least margin of those texels' depths


Shadows = Sequence[ShadowMap | None]


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
