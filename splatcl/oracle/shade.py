"""Shading: resolve the G-buffer and light each pixel once (deferred shading, [BHZK05]).

Vectors are in eye space: N the normal, L toward the light, V toward the eye, R the mirror image of L about N.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from splatcl.errors import SettingsError
from splatcl.oracle.buffers import Array, DepthBuffer, GBuffer, Shadows, Surface
from splatcl.oracle.geometry.rays import as_image, normalize, on_rays, pixel_rays, ray_length
from splatcl.oracle.lightmap import lightmap
from splatcl.oracle.shadow import lookup
from splatcl.scene.camera import Camera
from splatcl.scene.lights import Light, Material
from splatcl.scene.settings import RenderSettings

PHONG_TERMS = ("specular", "shininess")
"""Splat attributes that replace the material's coefficients of the same name."""


def shade(
    gbuffer: GBuffer,
    depth: DepthBuffer,
    camera: Camera,
    settings: RenderSettings,
    epsilon: float = 0.0,
    shadows: Shadows = (),
) -> dict[str, Array]:
    """Resolve the G-buffer and light each pixel once.

    Parameters
    ----------
    epsilon
        Depth tolerance of the attribute pass, scene units; only npr.contour="auto" reads it.
    shadows
        The lights' shadow maps (`shadow_maps`); no light casts shadows where they are left out.

    Returns
    -------
    dict
        `color` (H, W, 4) linear RGBA; `P` (scene units) and `N` (unit), both (H, W, 3) in eye space; `albedo`
        (H, W, 3) linear RGB; `depth.mean` along eye z and `depth.distance` along the ray, (H, W), scene units, +inf
        for an empty pixel; `attribute.NAME` (H, W) for each attribute.
    """
    s = as_image(pixel_rays(camera), camera)
    covered = gbuffer.weight_sum > 0
    weight_sum = np.where(covered, gbuffer.weight_sum, 1.0)
    mean = np.where(covered, gbuffer.depth_sum / weight_sum, np.inf)
    z = np.where(np.isfinite(depth.depth), depth.depth, mean)
    position = on_rays(s, np.where(covered, z, 0.0), camera)
    if camera.projection == "orthographic":
        position = np.where(covered[..., None], position, 0.0)
    with np.errstate(invalid="ignore", divide="ignore"):
        named = {name: np.nan_to_num(total / gbuffer.weight_sum) for name, total in gbuffer.attribute_sum.items()}
    albedo = gbuffer.color_sum / weight_sum[..., None]
    terms = phong_terms(named, settings.material)
    surface = Surface(position, normalize(gbuffer.normal_sum), albedo, gbuffer.weight_sum, *terms)
    return {
        "color": shade_surface(surface, camera, settings, epsilon, shadows),
        "P": surface.position,
        "N": surface.normal,
        "albedo": surface.albedo,
        "depth.mean": mean,
        "depth.distance": z * ray_length(camera, s),
        **{f"attribute.{name}": values for name, values in named.items()},
    }


def phong_terms(named: Mapping[str, Array], material: Material) -> tuple[Array | float, Array | float]:
    """Return the specular coefficient and the shininess: attributes of these names, else the material's.

    They are (..., 1) for attributes (...), and two numbers where `named` has neither of the two.
    """
    own = [named[name] for name in PHONG_TERMS if name in named]
    if not own:
        return material.specular, material.shininess
    specular, shininess = (named.get(name, np.full(own[0].shape, getattr(material, name))) for name in PHONG_TERMS)
    return specular[..., None], shininess[..., None]


def shade_surface(
    surface: Surface, camera: Camera, settings: RenderSettings, epsilon: float = 0.0, shadows: Shadows = ()
) -> Array:
    """Shade an image's surface: (H, W, 4) linear RGBA, 0 for an empty pixel. `epsilon`, `shadows` as for `shade`.

    Under shading="fragment" and "splat" the albedo is lit already and becomes the color.
    """
    covered = surface.covered
    if settings.shader == "user":
        raise SettingsError(
            "shader='user': the oracle cannot run a user's shader, which is OpenCL C; choose another shader"
        )
    if settings.shading != "deferred":
        rgb = surface.albedo
    elif settings.shader == "depth":
        rgb = np.repeat(_nearness(surface.position[..., 2], covered, camera)[..., None], 3, axis=-1)
    elif settings.shader == "npr":
        rgb = _npr(surface, camera, settings, epsilon, shadows)
    else:
        rgb = shade_points(surface, camera, settings, shadows)
    rgba = np.concatenate([rgb, np.ones((*covered.shape, 1))], axis=-1)
    return np.where(covered[..., None], rgba, 0.0)


def _nearness(z: Array, covered: Array, camera: Camera) -> Array:
    """Return (H, W) near / z; orthographic (far - z) / (far - near), or 1 / (1 + z - near) for an infinite far."""
    if camera.projection == "perspective":
        return camera.near / np.where(covered, z, 1.0)
    if np.isfinite(camera.far):
        return (camera.far - z) / (camera.far - camera.near)
    return 1 / np.where(covered, 1 + z - camera.near, 1.0)


def _npr(surface: Surface, camera: Camera, settings: RenderSettings, epsilon: float, shadows: Shadows) -> Array:
    """Return (H, W, 3) albedo times the tone of the diffuse light; the line's color on contours and silhouettes."""
    npr, normal, to_eye = settings.npr, surface.normal, _to_eye(surface.position, camera)
    light = np.zeros(normal.shape)
    for i in range(len(settings.lights)):
        to_light, tint = _arriving(i, surface.position, to_eye, camera, settings, shadows)
        light += np.maximum((normal * to_light).sum(axis=-1, keepdims=True), 0.0) * tint
    index = np.floor(np.clip(light, 0.0, 1.0) * len(npr.tones)).astype(int)
    tone = np.array(npr.tones)[np.minimum(index, len(npr.tones) - 1)]
    jump = _depth_jumps(np.where(surface.covered, surface.position[..., 2], np.inf))
    contour = 4 * epsilon if npr.contour == "auto" else npr.contour
    line = (jump > contour) | ((normal * to_eye).sum(axis=-1) < npr.silhouette)
    return np.where(line[..., None], npr.line, surface.albedo * tone)


def _depth_jumps(z: Array) -> Array:
    """Return (H, W) the largest difference of z in the 3x3 neighborhood, scene units; +inf beside an empty pixel."""
    height, width = z.shape
    jump = np.zeros(z.shape)
    for y in range(height):
        for x in range(width):
            around = z[max(y - 1, 0) : y + 2, max(x - 1, 0) : x + 2]
            jump[y, x] = np.abs(around - z[y, x]).max() if np.isfinite(z[y, x]) else np.inf
    return jump


def shade_points(surface: Surface, camera: Camera, settings: RenderSettings, shadows: Shadows = ()) -> Array:
    """Shade each surface point on its own: (..., 3) linear RGB, by Phong, light map, albedo or normal."""
    if settings.shader == "albedo":
        return surface.albedo
    if settings.shader == "normal":
        return 0.5 + 0.5 * surface.normal * (1.0, -1.0, -1.0)
    if settings.shader == "lightmap":
        return _from_lightmap(surface, camera, settings)
    return _phong(surface, camera, settings, shadows)


def _to_eye(position: Array, camera: Camera) -> Array:
    """Return V (..., 3), unit."""
    if camera.projection == "orthographic":
        return np.broadcast_to([0.0, 0.0, -1.0], position.shape)
    return normalize(-position)


def _from_lightmap(surface: Surface, camera: Camera, settings: RenderSettings) -> Array:
    """Light by Phong, (..., 3), with the sums over lights from the light map; ambient light alone where N is 0."""
    material, normal = settings.material, surface.normal
    diffuse, specular = lightmap(normal, _to_eye(surface.position, camera), camera, settings)
    lit = surface.albedo * material.diffuse * diffuse + surface.specular * specular
    return surface.albedo * material.ambient + np.where(normal.any(axis=-1, keepdims=True), lit, 0.0)


def _phong(surface: Surface, camera: Camera, settings: RenderSettings, shadows: Shadows) -> Array:
    """Light by Phong, (..., 3): albedo (ambient + diffuse sum max(N.L, 0)) + specular sum max(R.V, 0)^shininess.

    Each term of both sums is times the light's color; the specular one counts where N.L > 0.
    """
    material, normal, to_eye = settings.material, surface.normal, _to_eye(surface.position, camera)
    diffuse, specular = np.zeros(normal.shape), np.zeros(normal.shape)
    for i in range(len(settings.lights)):
        to_light, tint = _arriving(i, surface.position, to_eye, camera, settings, shadows)
        n_l = (normal * to_light).sum(axis=-1, keepdims=True)
        mirrored = 2 * n_l * normal - to_light
        r_v = np.maximum((mirrored * to_eye).sum(axis=-1, keepdims=True), 0.0)
        diffuse += np.maximum(n_l, 0.0) * tint
        specular += np.where(n_l > 0, r_v**surface.shininess, 0.0) * tint
    return surface.albedo * (material.ambient + material.diffuse * diffuse) + surface.specular * specular


def _arriving(
    i: int, position: Array, to_eye: Array, camera: Camera, settings: RenderSettings, shadows: Shadows
) -> tuple[Array, Array]:
    """Return L (..., 3) of light i, unit, and its linear RGB (..., 3) times its cone and its shadow."""
    light = settings.lights[i]
    to_light = _to_light(light, position, to_eye, camera)
    tint = _cone(light, to_light, camera) * light.color
    if shadows and (shadow_map := shadows[i]):
        tint = tint * lookup(shadow_map, position, camera).share[..., None]
    return to_light, tint


def _to_light(light: Light, position: Array, to_eye: Array, camera: Camera) -> Array:
    """Return L (..., 3), unit; a headlight is at the eye, so its L is V."""
    if light.kind == "headlight":
        return to_eye
    vector = camera.eye_from_world[:3, :3] @ light.vector
    if light.kind == "directional":
        return np.broadcast_to(normalize(vector), position.shape)
    return normalize(vector + camera.eye_from_world[:3, 3] - position)


def _cone(light: Light, to_light: Array, camera: Camera) -> Array:
    """Return the fraction (..., 1) of a spot's light: linear in the cosine, from 0 at `outer` to 1 at `inner`."""
    if light.kind != "spot":
        return np.ones((*to_light.shape[:-1], 1))
    direction = normalize(camera.eye_from_world[:3, :3] @ light.direction)
    inner, outer = np.cos(np.radians([light.inner, light.outer]))
    return np.clip(((-to_light @ direction)[..., None] - outer) / max(inner - outer, 1e-30), 0.0, 1.0)
