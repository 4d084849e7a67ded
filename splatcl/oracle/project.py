"""Project: move splats to eye space, decide their facing, and bound their footprints in the raster."""

from __future__ import annotations

import numpy as np

from splatcl.oracle.buffers import NOTHING, Array, ProjectedSplats
from splatcl.oracle.geometry.discs import disc_bounds
from splatcl.oracle.geometry.ellipse_maps import EllipseMaps
from splatcl.oracle.geometry.points import point_half
from splatcl.oracle.geometry.rays import (
    CLEAR,
    EDGE_ON,
    OFFSET_ERROR,
    TINY,
    UNIT,
    facing_cosine,
    normalize,
    range_margin,
    to_image_plane,
    to_raster,
)
from splatcl.scene.camera import Camera
from splatcl.scene.settings import RenderSettings
from splatcl.scene.splats import Splats


def project(splats: Splats, camera: Camera, settings: RenderSettings) -> ProjectedSplats:
    """Move splats from world to eye space, decide their facing and bound their footprints.

    A splat faces away iff n.c >= 0 (orthographic: n_z >= 0). The bounds are those of the footprint, its low-pass filter
    included, and of the pre-filter "min" ([BHZK05] section 5).
    """
    facing = settings.facing if splats.oriented else "flip"
    rotation, translation = camera.eye_from_world[:3, :3], camera.eye_from_world[:3, 3]
    center = splats.center.astype(np.float64) @ rotation.T + translation
    t_u = splats.tangent_u.astype(np.float64) @ rotation.T
    t_v = splats.tangent_v.astype(np.float64) @ rotation.T
    if settings.circular:
        t_u, t_v = _circles(t_u, t_v)
    normal = normalize(np.cross(t_u, t_v))
    cosine, cosine_scale = facing_cosine(center, t_u, t_v, camera)
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

    disc = disc_bounds(center, t_u, t_v, camera)
    point, error = _prefilter_point(center, t_u, t_v, disc, camera, settings)
    present = range_margin(center[:, 2], np.abs(center[:, 2]) + TINY, camera)
    present[(settings.prefilter != "min") | np.isnan(point).any(axis=1)] = -np.inf
    covered = _covered(center, t_u, t_v, disc, camera, settings)
    covered[np.abs(cosine) <= EDGE_ON] = NOTHING
    square = np.hstack([point - settings.prefilter_radius, point + settings.prefilter_radius])
    square[present < 0] = NOTHING
    bounds = np.hstack([np.minimum(covered, square)[:, :2], np.maximum(covered, square)[:, 2:]])
    bounds[culled] = NOTHING
    if settings.sprite == "point":
        half = point_half(t_u, t_v, center[:, 2], camera, settings, filtered=True)[:, None]
        middle = to_raster(to_image_plane(center, camera), camera)
        low, high = np.maximum(bounds[:, :2], middle - half), np.minimum(bounds[:, 2:], middle + half)
        outside = (low > high).any(axis=1) | (center[:, 2] < camera.near) | (center[:, 2] > camera.far)
        bounds = np.where(outside[:, None], NOTHING, np.hstack([low, high]))
    hidden = (center[:, 2:] <= 0) & (camera.projection == "perspective")
    center_raster = np.where(hidden, np.nan, to_raster(to_image_plane(center, camera), camera))
    return ProjectedSplats(
        center, t_u, t_v, normal, center_raster, bounds, culled, facing_margin, point, error, present,
        field_u, field_v, clip,
    )  # fmt: skip


def _covered(center: Array, t_u: Array, t_v: Array, disc: Array, camera: Camera, settings: RenderSettings) -> Array:
    """Bound the footprints, low-pass filter included: (N, 4) pixels, of the discs or of their ellipses."""
    if settings.footprint != "raycast":
        maps = EllipseMaps.of(center, t_u, t_v, camera, settings)
        return maps.bounds(maps.exists)
    reach = np.hypot(t_u[:, 2], t_v[:, 2])
    unseen = (center[:, 2] + reach < camera.near) | (center[:, 2] - reach > camera.far)
    return np.where(unseen[:, None], NOTHING, disc)


def _circles(t_u: Array, t_v: Array) -> tuple[Array, Array]:
    """Return the tangents (N, 3) of the circle around each disc, as large as the longer axis; u keeps its direction."""
    radius = np.maximum(np.linalg.norm(t_u, axis=1), np.linalg.norm(t_v, axis=1))[:, None]
    u = normalize(t_u)
    return radius * u, radius * np.cross(normalize(np.cross(t_u, t_v)), u)


def _field(values: Array | None, rotation: Array, settings: RenderSettings, normal: Array) -> Array:
    """Rotate a normal field's change along one axis to eye space, (N, 3); zero under normals="constant"."""
    if values is None or settings.normals == "constant":
        return np.zeros(normal.shape)
    return values.astype(np.float64) @ rotation.T


def _prefilter_point(
    center: Array, t_u: Array, t_v: Array, disc: Array, camera: Camera, settings: RenderSettings
) -> tuple[Array, Array]:
    """Return the pre-filter's center (N, 2), pixels, and its error (N,), 2^-24 pixels.

    It is the projected center, or that of the bounds of the disc or of the parallelogram c +- t_u +- t_v; NaN for
    infinite bounds.
    """
    raster = to_raster(to_image_plane(center, camera), camera)
    error = np.full(len(center), OFFSET_ERROR)
    if settings.prefilter_center == "projected":
        return raster, error
    if settings.prefilter_center == "parallelogram":
        middle, moved = _parallelogram_middle(center, t_u, t_v, camera)
        return middle, error + moved
    z, reach = center[:, 2] ** 2, t_u[:, 2] ** 2 + t_v[:, 2] ** 2
    with np.errstate(invalid="ignore", divide="ignore"):
        middle = (disc[:, :2] + disc[:, 2:]) / 2
        return middle, error + np.abs(middle - raster).sum(axis=1) * (z + reach) / np.abs(z - reach)


def _parallelogram_middle(center: Array, t_u: Array, t_v: Array, camera: Camera) -> tuple[Array, Array]:
    """Return the center (N, 2) of the bounds of the projected corners c +- t_u +- t_v, and its error (N,).

    The error is in 2^-24 pixels. The center is NaN where a corner is not `CLEAR` of the eye plane. A corner errs by
    its terms, divided by its z.
    """
    corners = [center + i * t_u + j * t_v for i in (-1, 1) for j in (-1, 1)]
    raster = np.stack([to_raster(to_image_plane(corner, camera), camera) for corner in corners])
    with np.errstate(invalid="ignore"):  # infinite bounds of both signs have no middle
        middle = (raster.min(axis=0) + raster.max(axis=0)) / 2
    focal = np.array([camera.fx, camera.fy])
    terms = np.abs(t_u[:, :2]) + np.abs(t_v[:, :2])
    if camera.projection == "orthographic":
        return middle, (terms * focal).sum(axis=1)
    z, reach = center[:, 2], np.abs(t_u[:, 2]) + np.abs(t_v[:, 2])
    clear = z - reach > CLEAR * z
    with np.errstate(invalid="ignore", divide="ignore"):
        terms = (terms + np.abs(center[:, :2] / z[:, None]) * reach[:, None]) * focal
        error = terms.sum(axis=1) / (z - reach) * (z + reach) / (z - reach)
    return np.where(clear[:, None], middle, np.nan), np.where(clear, error, np.inf)
