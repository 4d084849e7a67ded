"""Shading: resolve the G-buffer and light each pixel once."""

from __future__ import annotations

import numpy as np

from splatcl.errors import SettingsError
from splatcl.oracle.buffers import Array, DepthBuffer, GBuffer, Shadows
from splatcl.oracle.geometry.rays import as_image, normalize, pixel_rays, ray_length
from splatcl.oracle.lightmap import lightmap
from splatcl.oracle.shadow import lookup
from splatcl.scene.camera import Camera
from splatcl.scene.lights import Light
from splatcl.scene.settings import RenderSettings


def shade(
    gbuffer: GBuffer,
    depth: DepthBuffer,
    camera: Camera,
    settings: RenderSettings,
    gloss: Array | None = None,
    epsilon: float = 0.0,
    shadows: Shadows = (),
) -> dict[str, Array]:
    """Resolve the G-buffer and light each pixel once.

    `gloss` (H, W, 2) is specular and shininess of each pixel; `epsilon`, scene units, is for contours alone;
    `shadows` are the lights' maps (`shadow_maps`), none where omitted.

    Returns
    -------
    dict
        `color` (H, W, 4) linear RGBA; `P`, `N` (H, W, 3) eye space; `albedo` (H, W, 3);
        `depth.mean`, `depth.distance` (H, W) scene units, +inf where there is nothing.
    """
    s = as_image(pixel_rays(camera), camera)
    covered = gbuffer.weight_sum > 0
    weight_sum = np.where(covered, gbuffer.weight_sum, 1.0)
    mean = np.where(covered, gbuffer.depth_sum / weight_sum, np.inf)
    albedo = gbuffer.color_sum / weight_sum[..., None]
    normal = normalize(gbuffer.normal_sum)
    z = np.where(np.isfinite(depth.depth), depth.depth, mean)
    z_covered = np.where(covered, z, 0.0)[..., None]
    if camera.projection == "perspective":
        position = z_covered * s
    else:
        position = np.where(covered[..., None], np.concatenate([s[..., :2], z_covered], axis=-1), 0.0)
    return {
        "color": color(position, normal, albedo, covered, camera, settings, gloss, epsilon, shadows),
        "P": position,
        "N": normal,
        "albedo": albedo,
        "depth.mean": mean,
        "depth.distance": z * ray_length(camera, s),
    }


def color(
    position: Array,
    normal: Array,
    albedo: Array,
    covered: Array,
    camera: Camera,
    settings: RenderSettings,
    gloss: Array | None = None,
    epsilon: float = 0.0,
    shadows: Shadows = (),
) -> Array:
    """(H, W, 4) linear RGBA of the AOVs P, N and albedo (H, W, 3) where `covered` (H, W); the rest as for `shade`."""
    if settings.shader == "user":
        raise SettingsError("the oracle cannot run a user's shader, which is OpenCL C")
    if settings.shading != "deferred":  # it was lit before it was blended
        rgb = albedo
    elif settings.shader == "depth":
        rgb = np.repeat(_nearness(position[..., 2], covered, camera)[..., None], 3, axis=-1)
    elif settings.shader == "npr":
        rgb = _npr(position, normal, albedo, covered, camera, settings, epsilon, shadows)
    else:
        rgb = shade_points(position, normal, albedo, camera, settings, gloss, shadows)
    rgba = np.concatenate([rgb, np.ones((*covered.shape, 1))], axis=-1)
    return np.where(covered[..., None], rgba, 0.0)


def _nearness(z: Array, covered: Array, camera: Camera) -> Array:
    """(H, W) near / z; orthographic (far - z) / (far - near), or 1 / (1 + z - near) where far is infinite."""
    if camera.projection == "perspective":
        return camera.near / np.where(covered, z, 1.0)
    if np.isfinite(camera.far):
        return (camera.far - z) / (camera.far - camera.near)
    return 1 / np.where(covered, 1 + z - camera.near, 1.0)


def _npr(
    position: Array,
    normal: Array,
    albedo: Array,
    covered: Array,
    camera: Camera,
    settings: RenderSettings,
    epsilon: float,
    shadows: Shadows,
) -> Array:
    """(H, W, 3) albedo times the tone that the diffuse light chooses, or the line's colour."""
    npr, light, to_eye = settings.npr, np.zeros(normal.shape), _to_eye(position, camera)
    for i in range(len(settings.lights)):
        toward, tint = _arriving(i, position, to_eye, camera, settings, shadows)
        light += np.maximum((normal * toward).sum(axis=-1, keepdims=True), 0.0) * tint
    place = np.floor(np.clip(light, 0.0, 1.0) * len(npr.tones)).astype(int)
    tone = np.array(npr.tones)[np.minimum(place, len(npr.tones) - 1)]
    jump = _jumps(np.where(covered, position[..., 2], np.inf))
    contour = 4 * epsilon if npr.contour == "auto" else npr.contour
    line = (jump > contour) | ((normal * to_eye).sum(axis=-1) < npr.silhouette)
    return np.where(line[..., None], npr.line, albedo * tone)


def _jumps(z: Array) -> Array:
    """(H, W) the greatest difference between a pixel's z and one of its 3x3 neighbourhood's; inf beside nothing."""
    height, width = z.shape
    jump = np.zeros(z.shape)
    for y in range(height):
        for x in range(width):
            around = z[max(y - 1, 0) : y + 2, max(x - 1, 0) : x + 2]
            jump[y, x] = np.abs(around - z[y, x]).max() if np.isfinite(z[y, x]) else np.inf
    return jump


def shade_points(
    position: Array,
    normal: Array,
    albedo: Array,
    camera: Camera,
    settings: RenderSettings,
    gloss: Array | None = None,
    shadows: Shadows = (),
) -> Array:
    """(..., 3) linear RGB of points of a surface, each by itself; `gloss` as for `shade`, (..., 2), `shadows` too."""
    if settings.shader == "albedo":
        return albedo
    if settings.shader == "normal":
        return 0.5 + 0.5 * normal * (1.0, -1.0, -1.0)
    to_eye = _to_eye(position, camera)
    if settings.shader == "lightmap":
        return _from_lightmap(normal, albedo, to_eye, camera, settings, gloss)
    return _phong(position, normal, albedo, to_eye, camera, settings, gloss, shadows)


def _to_eye(position: Array, camera: Camera) -> Array:
    """(..., 3) unit."""
    if camera.projection == "orthographic":
        return np.broadcast_to([0.0, 0.0, -1.0], position.shape)
    return normalize(-position)


def _from_lightmap(
    normal: Array, albedo: Array, to_eye: Array, camera: Camera, settings: RenderSettings, gloss: Array | None
) -> Array:
    """(..., 3) Phong with the light map's sums; ambient light alone where there is no normal."""
    material = settings.material
    diffuse, specular = lightmap(normal, to_eye, camera, settings)
    strength: Array | float = material.specular if gloss is None else gloss[..., :1]
    lit = albedo * material.diffuse * diffuse + strength * specular
    return albedo * material.ambient + np.where(normal.any(axis=-1, keepdims=True), lit, 0.0)


def _phong(
    position: Array,
    normal: Array,
    albedo: Array,
    to_eye: Array,
    camera: Camera,
    settings: RenderSettings,
    gloss: Array | None,
    shadows: Shadows,
) -> Array:
    """(H, W, 3) albedo (ambient + diffuse sum max(N.L, 0)) + specular sum max(R.V, 0)^shininess."""
    material = settings.material
    strength: Array | float = material.specular if gloss is None else gloss[..., :1]
    shininess: Array | float = material.shininess if gloss is None else gloss[..., 1:]
    diffuse, specular = np.zeros(normal.shape), np.zeros(normal.shape)
    for i in range(len(settings.lights)):
        to_light, tint = _arriving(i, position, to_eye, camera, settings, shadows)
        n_l = (normal * to_light).sum(axis=-1, keepdims=True)
        mirrored = 2 * n_l * normal - to_light
        r_v = np.maximum((mirrored * to_eye).sum(axis=-1, keepdims=True), 0.0)
        diffuse += np.maximum(n_l, 0.0) * tint
        specular += np.where(n_l > 0, r_v**shininess, 0.0) * tint
    return albedo * (material.ambient + material.diffuse * diffuse) + strength * specular


def _arriving(
    i: int, position: Array, to_eye: Array, camera: Camera, settings: RenderSettings, shadows: Shadows
) -> tuple[Array, Array]:
    """(..., 3) unit vectors toward light i; (..., 3) its colour times its cone and its shadow."""
    light = settings.lights[i]
    to_light = _to_light(light, position, to_eye, camera)
    tint = _cone(light, to_light, camera) * light.color
    if shadows and (shadow_map := shadows[i]):
        tint = tint * lookup(shadow_map, position, camera).share[..., None]
    return to_light, tint


def _to_light(light: Light, position: Array, to_eye: Array, camera: Camera) -> Array:
    """(H, W, 3) unit eye-space vectors toward the light; a headlight's go where the eye is."""
    if light.kind == "headlight":
        return to_eye
    vector = camera.eye_from_world[:3, :3] @ light.vector
    if light.kind == "directional":
        return np.broadcast_to(normalize(vector), position.shape)
    return normalize(vector + camera.eye_from_world[:3, 3] - position)


def _cone(light: Light, to_light: Array, camera: Camera) -> Array:
    """(..., 1) how much of a spot's light goes this way: linear in the cosine between its two angles."""
    if light.kind != "spot":
        return np.ones((*to_light.shape[:-1], 1))
    direction = normalize(camera.eye_from_world[:3, :3] @ light.direction)
    inner, outer = np.cos(np.radians([light.inner, light.outer]))
    return np.clip(((-to_light @ direction)[..., None] - outer) / max(inner - outer, 1e-30), 0.0, 1.0)
