"""The scenes of the golden images.

They are built from an integer hash with + - * / alone, in float64, so every machine builds the same bits. Camera
matrices are multiples of 2^-20, so products with them are exact on the host. check.py has the hashes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from splatcl.evidence.golden.splats import (
    edge_on,
    layers,
    random_discs,
    rotations,
    tiny_discs,
    with_attributes,
    with_clip,
    with_field,
)
from splatcl.scene.camera import Camera
from splatcl.scene.lights import Light, Material
from splatcl.scene.settings import RenderSettings
from splatcl.scene.splats import Splats

LIGHTS = (
    Light(color=(0.5, 0.5, 0.5)),
    Light("point", (1.0, 2.0, -1.5), (0.75, 0.25, 0.0)),
    Light("directional", (0.0, 4.0, 0.0), (0.0, 0.25, 0.5)),
)
TABLE = (1.0, 0.875, 0.5625, 0.25, 0.0625)


@dataclass(frozen=True)
class GoldenScene:
    """One image to render; `tiny` ones are 15x13 with twenty splats, for slow devices such as interpreters."""

    name: str
    splats: Splats
    camera: Camera
    settings: RenderSettings

    @property
    def tiny(self) -> bool:
        """True if the name begins with "tiny"."""
        return self.name.startswith("tiny")

    @property
    def plain(self) -> bool:
        """True if the method is [BHZK05]'s, and the splats have no clip lines and no attributes of their own."""
        wanted, splats = self.settings, self.splats
        usual = (wanted.method, wanted.footprint, wanted.target) == ("botsch05", "raycast", "auto")
        return usual and splats.clip is None and not splats.attributes


@cache
def scenes() -> tuple[GoldenScene, ...]:
    """Return every scene; its name says what it covers, and ends with "_double" for double precision."""
    turn = (7, 1, -2, 1)
    discs, small, layered, tiny = (
        random_discs(1, 160, 1.25, 0.25),
        random_discs(3, 900, 1.25, 0.015625),
        layers(),
        tiny_discs(),
    )
    far, before, tiny_camera = camera(turn, z=4.0), camera(), camera(near=1.0, focal=30.0, size=(15, 13))
    flat = replace(far, projection="orthographic", fx=16.0, fy=15.0)
    tiny_flat = replace(tiny_camera, projection="orthographic", fx=10.0, fy=9.0)
    bounds = RenderSettings(0.25, prefilter_center="bounds", prefilter_radius=2.0, facing="flip")
    ray = RenderSettings(0.125, along="ray")
    table = RenderSettings(0.125, kernel="table", kernel_table=TABLE, kernel_lookup="linear")
    texture = replace(table, table_addressing="texture")
    lights = RenderSettings(0.125, lights=LIGHTS, material=Material(0.125, 0.5, 0.5, 7.5))
    found = [
        GoldenScene("ordinary", discs, far, RenderSettings(0.125)),
        GoldenScene("near_plane", random_discs(2, 90, 1.5, 0.5), camera(turn, z=0.75, near=0.5), RenderSettings(0.25)),
        GoldenScene("edge_on", edge_on(), before, RenderSettings(0.125, shader="normal")),
        GoldenScene("orthographic", discs, flat, RenderSettings(0.125, facing="flip", shader="normal")),
        GoldenScene("sub_pixel", small, far, RenderSettings(0.0625)),
        GoldenScene("sub_pixel_bounds", small, far, bounds),
        GoldenScene("filter_plane", small, far, RenderSettings(0.0625, filter_depth="plane")),
        GoldenScene("filter_front", small, far, RenderSettings(0.0625, filter_depth="front")),
        GoldenScene("layers", layered, before, RenderSettings(0.125, shader="albedo")),
        GoldenScene("layers_front", layered, before, RenderSettings(0.0, shader="albedo")),
        GoldenScene("layers_strict", layered, before, RenderSettings(0.125, shader="albedo", epsilon_test="strict")),
        GoldenScene("strict_zero", discs, far, RenderSettings(0.0, shader="albedo", epsilon_test="strict")),
        GoldenScene("along_ray", layered, before, ray),
        GoldenScene("along_ray_orthographic", discs, flat, ray),
        GoldenScene("culled", discs, far, RenderSettings(0.125, prefilter="none", facing="cull", shader="albedo")),
        GoldenScene("constant", discs, far, RenderSettings(0.125, kernel="constant", facing="flip")),
        GoldenScene("table_nearest", discs, far, replace(table, kernel_lookup="nearest", prefilter="none")),
        GoldenScene("table_linear", discs, far, table),
        GoldenScene("table_texture", discs, far, texture),
        GoldenScene("table_texture_r2", discs, far, replace(texture, kernel_lookup="nearest", table_over="r2")),
        GoldenScene("lights", discs, far, lights),
        GoldenScene("far_from_origin", *moved(discs, far, (2.0**19, -(2.0**22), 96.0)), RenderSettings(0.125)),
        GoldenScene("tiny", tiny, tiny_camera, lights),
        GoldenScene("tiny_bounds", tiny, tiny_camera, replace(bounds, shader="normal", along="ray")),
        GoldenScene("tiny_parallelogram", tiny, tiny_camera, replace(bounds, prefilter_center="parallelogram")),
        GoldenScene("tiny_point", tiny, tiny_camera, RenderSettings(0.125, sprite="point")),
        GoldenScene("tiny_table", tiny, tiny_camera, replace(table, prefilter="none", facing="cull", shader="albedo")),
        GoldenScene("tiny_nearest", tiny, tiny_camera, replace(table, kernel_lookup="nearest")),
        GoldenScene("tiny_constant", tiny, tiny_camera, RenderSettings(0.125, kernel="constant")),
        GoldenScene("tiny_orthographic", tiny, tiny_flat, ray),
        *methods(discs, small, tiny, far, flat, tiny_camera),
    ]
    twice = ["ordinary", "near_plane", "orthographic", "sub_pixel_bounds", "table_linear", "lights", "tiny"]
    twice += ["zwicker04", "float16"]
    doubled = [s for s in found if s.name in twice]
    found += [replace(s, name=f"{s.name}_double", settings=replace(s.settings, precision="double")) for s in doubled]
    return tuple(found)


def methods(
    discs: Splats, small: Splats, tiny: Splats, far: Camera, flat: Camera, tiny_camera: Camera
) -> list[GoldenScene]:
    """Return the scenes of other methods and shaders. Their settings share programs where possible, to build fewer."""
    conic, circles = RenderSettings(0.125, method="zwicker04"), RenderSettings(0.125, method="botsch03", lights=LIGHTS)
    fragments = RenderSettings(0.125, method="botsch04", lights=LIGHTS, material=Material(0.125, 0.5, 0.5, 7.5))
    deferred = replace(fragments, normals="constant", shading="deferred", facing="cull")
    targets = RenderSettings(0.125)
    overflow = replace(targets, target="float16", shader="albedo")
    bright = replace(discs, color=discs.color * np.float32(65536), on_invalid="error")
    everything = with_clip(with_attributes(with_field(tiny)))
    sun = Light("directional", (1.0, 2.0, -1.0), shadow="pcf", map_size=64)
    spot = Light("spot", (0.0, 2.0, -3.0), (0.75, 0.5, 0.25), (0.0, -0.5, 1.0), 20.0, 40.0, "nearest", map_size=64)
    shadows = RenderSettings(0.125, lights=(Light(color=(0.25, 0.25, 0.25)), sun, spot))
    lightmap = RenderSettings(0.125, shader="lightmap", lights=(Light(), replace(sun, shadow="none")))
    return [
        GoldenScene("shadows", discs, far, shadows),
        GoldenScene("npr", discs, far, RenderSettings(0.125, shader="npr")),
        GoldenScene("depth", discs, far, RenderSettings(0.125, shader="depth")),
        GoldenScene("lightmap", discs, far, lightmap),
        GoldenScene("tiny_shadows", tiny, tiny_camera, replace(shadows, shader="npr")),
        GoldenScene("zwicker04", discs, far, conic),
        GoldenScene("zwicker01", small, far, RenderSettings(0.125, method="zwicker01", facing="cull")),
        GoldenScene("botsch04", with_field(discs), far, replace(fragments, facing="flip")),
        GoldenScene("botsch03", discs, far, replace(circles, facing="cull")),
        GoldenScene("ewa_orthographic", discs, flat, replace(conic, prefilter_radius=1.5, facing="cull")),
        GoldenScene("affine_min", small, far, RenderSettings(0.125, footprint="affine", facing="cull")),
        GoldenScene("clip", with_clip(discs), far, RenderSettings(0.125)),
        GoldenScene("attributes", with_attributes(discs), far, deferred),
        GoldenScene("float16", discs, far, replace(targets, target="float16")),
        GoldenScene("float16_overflow", bright, far, overflow),
        GoldenScene("float16_clamped", bright, far, replace(overflow, target="float16_clamped")),
        GoldenScene("unorm8", discs, far, replace(targets, target="unorm8", half_inputs=True)),
        GoldenScene("tiny_zwicker04", tiny, tiny_camera, conic),
        GoldenScene("tiny_botsch03", tiny, tiny_camera, replace(circles, facing="cull")),
        GoldenScene("tiny_everything", everything, tiny_camera, fragments),
    ]


def camera(
    turn: tuple[float, float, float, float] = (1, 0, 0, 0),
    z: float = 0.0,
    near: float = 0.125,
    focal: float = 50.0,
    size: tuple[int, int] = (44, 36),
) -> Camera:
    """Return a camera turned by a quaternion, its rotation rounded, with the world's origin at eye z `z`."""
    matrix = np.eye(4)
    matrix[:3, :3] = np.rint(rotations(np.array([turn], np.float64))[0] * 2.0**20) * 2.0**-20
    matrix[2, 3] = z
    width, height = size
    return Camera(
        matrix, focal, focal * 0.9375, width / 2 + 0.25, height / 2 - 0.375, width, height, near=near, far=64.0
    )


def moved(splats: Splats, eye: Camera, offset: tuple[float, float, float]) -> tuple[Splats, Camera]:
    """Return a scene moved by `offset`, with float64 centers; multiples of 2^-20 keep every product exact."""
    matrix = eye.eye_from_world.copy()
    matrix[:3, 3] -= (matrix[:3, :3] * np.array(offset)).sum(axis=1)
    center = np.rint(splats.center.astype(np.float64) * 1024) / 1024 + np.array(offset)
    return Splats(center, splats.tangent_u, splats.tangent_v, splats.color), replace(eye, eye_from_world=matrix)
