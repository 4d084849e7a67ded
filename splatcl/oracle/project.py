"""Project: splats in eye space, which way they face, and bounds of what they cover."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from splatcl.camera import Camera
from splatcl.oracle.geometry.ellipse_maps import _maps
from splatcl.oracle.geometry.rays import (
    CLEAR,
    EDGE_ON,
    NOTHING,
    OFFSET_ERROR,
    TINY,
    UNIT,
    Array,
    _cosine,
    _normalize,
    _range_margin,
    _raster,
    _s_center,
)
from splatcl.settings import RenderSettings
from splatcl.splats import Splats


@dataclass(frozen=True, eq=False)
class ProjectedSplats:
    """Splats in eye space (scene units) with their projections in raster space (pixels)."""

    center_eye: Array  # (N, 3)
    tangent_u_eye: Array  # (N, 3)
    tangent_v_eye: Array  # (N, 3)
    normal_eye: Array  # (N, 3) unit; turned toward the eye under facing="flip"
    center_raster: Array  # (N, 2) the projected centre; NaN where a perspective z <= 0
    bounds: Array  # (N, 4) x_min y_min x_max y_max of what the splat can cover; `NOTHING` where nothing
    culled: Array  # (N,) bool: dropped by facing="cull"
    facing_margin: Array  # (N,) signed: < 0 culled; +inf where facing decides nothing
    prefilter_point: Array  # (N, 2) where r2 would be measured from
    prefilter_error: Array  # (N,) float32 error of that point, 2^-24 pixels
    prefilter_margin: Array  # (N,) signed: the centre's z in [near, far]; -inf where there is no pre-filter
    field_u: Array  # (N, 3) the normal changes so much along u; zero where it does not
    field_v: Array  # (N, 3)
    clip: Array  # (N, 2, 3) clip lines a u + b v + c >= 0; zeros for none

    @property
    def prefilter_center(self) -> Array:
        """(N, 2) where r2 is measured from; NaN where there is no pre-filter."""
        return np.where(self.prefilter_margin[:, None] >= 0, self.prefilter_point, np.nan)


def project(splats: Splats, camera: Camera, settings: RenderSettings) -> ProjectedSplats:
    """Move splats to eye space, decide their facing and bound their projections."""
    facing = settings.facing if splats.oriented else "flip"
    rotation, translation = camera.eye_from_world[:3, :3], camera.eye_from_world[:3, 3]
    center = splats.center.astype(np.float64) @ rotation.T + translation
    t_u = splats.tangent_u.astype(np.float64) @ rotation.T
    t_v = splats.tangent_v.astype(np.float64) @ rotation.T
    if settings.circular:
        t_u, t_v = _circles(t_u, t_v)
    normal = _normalize(np.cross(t_u, t_v))
    cosine, cosine_scale = _cosine(center, t_u, t_v, camera)
    away = cosine >= 0
    culled = away & (facing == "cull")
    if facing == "flip":
        normal = np.where(away[:, None], -normal, normal)
    field_u, field_v = (_field(values, rotation, settings, normal) for values in (splats.normal_du, splats.normal_dv))
    if facing == "flip":
        field_u, field_v = (np.where(away[:, None], -field, field) for field in (field_u, field_v))
    clip = np.zeros((len(splats), 2, 3)) if splats.clip is None else splats.clip.astype(np.float64)
    facing_margin = np.where(culled, -1, 1) * np.abs(cosine) / (UNIT * cosine_scale)
    if facing == "keep":
        facing_margin = np.full(len(splats), np.inf)

    disc = _disc_bounds(center, t_u, t_v, camera)
    point, error = _prefilter_point(center, t_u, t_v, disc, camera, settings)
    present = _range_margin(center[:, 2], np.abs(center[:, 2]) + TINY, camera)
    present[(settings.prefilter != "min") | np.isnan(point).any(axis=1)] = -np.inf
    covered = _covered(center, t_u, t_v, disc, camera, settings)
    covered[np.abs(cosine) <= EDGE_ON] = NOTHING
    square = np.hstack([point - settings.prefilter_radius, point + settings.prefilter_radius])
    square[present < 0] = NOTHING
    bounds = np.hstack([np.minimum(covered, square)[:, :2], np.maximum(covered, square)[:, 2:]])
    bounds[culled] = NOTHING
    hidden = (center[:, 2:] <= 0) & (camera.projection == "perspective")
    center_raster = np.where(hidden, np.nan, _raster(_s_center(center, camera), camera))
    return ProjectedSplats(
        center, t_u, t_v, normal, center_raster, bounds, culled, facing_margin, point, error, present,
        field_u, field_v, clip,
    )  # fmt: skip


def _covered(center: Array, t_u: Array, t_v: Array, disc: Array, camera: Camera, settings: RenderSettings) -> Array:
    """(N, 4) bounds of the footprints, low-pass filter included: of the discs, or of their ellipses."""
    if settings.footprint != "raycast":
        maps = _maps(center, t_u, t_v, camera, settings)
        return maps.bounds(maps.exists)
    reach = np.hypot(t_u[:, 2], t_v[:, 2])
    unseen = (center[:, 2] + reach < camera.near) | (center[:, 2] - reach > camera.far)
    return np.where(unseen[:, None], NOTHING, disc)


def _circles(t_u: Array, t_v: Array) -> tuple[Array, Array]:
    """Return tangents of the circle about each disc, of its longer axis' radius; u keeps its direction."""
    radius = np.maximum(np.linalg.norm(t_u, axis=1), np.linalg.norm(t_v, axis=1))[:, None]
    u = _normalize(t_u)
    return radius * u, radius * np.cross(_normalize(np.cross(t_u, t_v)), u)


def _field(values: Array | None, rotation: Array, settings: RenderSettings, normal: Array) -> Array:
    """(N, 3) a normal field's change along one axis, eye space; zero where the settings take none."""
    if values is None or settings.normals == "constant":
        return np.zeros(normal.shape)
    return values.astype(np.float64) @ rotation.T


def bin(projected: ProjectedSplats, camera: Camera, tile_size: int) -> list[Array]:
    """Return, for each tile in row-major order, the increasing indices of the splats whose bounds reach it.

    A tile is reached where the bounds overlap the box of its pixels' centres, edges included.
    """
    x_min, y_min, x_max, y_max = projected.bounds.T
    tiles = []
    for y in range(0, camera.height, tile_size):
        for x in range(0, camera.width, tile_size):
            x_last, y_last = min(x + tile_size, camera.width) - 1, min(y + tile_size, camera.height) - 1
            inside_x = (x_max >= x + 0.5) & (x_min <= x_last + 0.5)
            inside_y = (y_max >= y + 0.5) & (y_min <= y_last + 0.5)
            tiles.append(np.flatnonzero(inside_x & inside_y))
    return tiles


def _disc_bounds(center: Array, t_u: Array, t_v: Array, camera: Camera) -> Array:
    """(N, 4) bounds of the whole discs' projections, pixels; infinite where one is not clear of the eye plane.

    With t_x = (t_u,x, t_v,x) and t_z alike, the plane x = s z touches the disc where
    |t_x - s t_z|^2 = (c_x - s c_z)^2, a quadratic in s; the same for y.
    """
    t = np.stack([t_u, t_v], axis=-1)  # (N, 3, 2)
    t_xy, t_z, c_xy, c_z = t[:, :2], t[:, 2:], center[:, :2], center[:, 2:]
    if camera.projection == "orthographic":
        half = np.linalg.norm(t_xy, axis=2)
        low, high = c_xy - half, c_xy + half
    else:
        p = (t_z**2).sum(axis=2) - c_z**2  # < 0 where the disc stays clear of the eye plane
        q = (t_xy * t_z).sum(axis=2) - c_xy * c_z
        g_yx = t[:, :2, 0] * t[:, 2:, 1] - t[:, :2, 1] * t[:, 2:, 0]
        root = np.sqrt(np.maximum(((c_z[..., None] * t_xy - c_xy[..., None] * t_z) ** 2).sum(axis=2) - g_yx**2, 0))
        clear = c_z - np.linalg.norm(t_z, axis=2) > CLEAR * c_z
        with np.errstate(divide="ignore", invalid="ignore"):
            low = np.where(clear, (q + root) / p, -np.inf)
            high = np.where(clear, (q - root) / p, np.inf)
    return np.concatenate([_raster(low, camera), _raster(high, camera)], axis=1)


def _prefilter_point(
    center: Array, t_u: Array, t_v: Array, disc: Array, camera: Camera, settings: RenderSettings
) -> tuple[Array, Array]:
    """(N, 2) the projected centre, or the bounds' (NaN if infinite); (N,) its error, 2^-24 pixels."""
    raster = _raster(_s_center(center, camera), camera)
    error = np.full(len(center), OFFSET_ERROR)
    if settings.prefilter_center == "projected":
        return raster, error
    z, reach = center[:, 2] ** 2, t_u[:, 2] ** 2 + t_v[:, 2] ** 2
    with np.errstate(invalid="ignore", divide="ignore"):
        middle = (disc[:, :2] + disc[:, 2:]) / 2
        return middle, error + np.abs(middle - raster).sum(axis=1) * (z + reach) / np.abs(z - reach)
