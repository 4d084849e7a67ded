"""Small scenes that the tests share: deterministic by seed, read-only, in float32, which is exact on the device.

Every builder takes a seed and returns `Splats` around the world's origin, for cameras at `EYE` or near it. `SCENES` and
`CAMERAS` name them. `ADVERSARIAL` scenes are ill-conditioned on purpose.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from splatcl import Camera, Splats

EYE = np.array([0.0, 0.0, 3.0])
SIZE = {"width": 49, "height": 37}
"""Size of the images, pixels: no multiple of a tile or block. The oracle draws a scene in about a tenth of a second."""
EPSILON = 0.03125


def frames(normal):
    """Return two (N, 3) arrays of unit tangents, perpendicular to each other and to `normal`."""
    normal = np.atleast_2d(normal) / np.linalg.norm(normal, axis=-1, keepdims=True)
    away = np.where(np.abs(normal[:, :1]) < 0.9, [[1.0, 0, 0]], [[0.0, 1, 0]])
    u = np.cross(normal, away)
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    return u, np.cross(normal, u)


def log_uniform(rng, low, high, num):
    return np.exp(rng.uniform(np.log(low), np.log(high), (num, 1)))


def make(rng, center, tangent_u, tangent_v):
    """Return splats rounded to float32, with random colors."""
    arrays = (center, tangent_u, tangent_v, rng.uniform(0, 1, (len(center), 3)))
    center, tangent_u, tangent_v, color = (array.astype(np.float32) for array in arrays)
    return Splats(center, tangent_u, tangent_v, color=color)


def random_ellipses(seed=0, num=200):
    """Return ellipses of every size, aspect and pose in the box [-1.2, 1.2]^2 x [-1, 1]."""
    rng = np.random.default_rng(seed)
    u, v = frames(rng.normal(size=(num, 3)))
    radius = log_uniform(rng, 0.01, 0.6, num)
    center = rng.uniform(-1, 1, (num, 3)) * [1.2, 1.2, 1.0]
    return make(rng, center, u * radius, v * radius * log_uniform(rng, 0.05, 1, num))


def thin(seed=0, num=200):
    """Return needles: their axes differ in length by 30 to 10 000 times."""
    rng = np.random.default_rng(seed)
    u, v = frames(rng.normal(size=(num, 3)))
    radius = log_uniform(rng, 0.1, 1, num)
    return make(rng, rng.uniform(-1, 1, (num, 3)), u * radius, v * radius * log_uniform(rng, 1e-4, 0.03, num))


def edge_on(seed=0, num=200, parallel=False):
    """Return discs tilted 1e-7 to 0.1 out of the line of sight from EYE (`parallel`: out of the z direction)."""
    rng = np.random.default_rng(seed)
    center = rng.uniform(-1, 1, (num, 3))
    sight = np.tile([[0.0, 0, -1]], (num, 1)) if parallel else center - EYE
    sight /= np.linalg.norm(sight, axis=1, keepdims=True)
    across = np.cross(sight, rng.normal(size=(num, 3)))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    u, v = frames(across + log_uniform(rng, 1e-7, 0.1, num) * rng.choice([-1, 1], (num, 1)) * sight)
    angle, radius = rng.uniform(0, 2 * np.pi, (num, 1)), log_uniform(rng, 0.01, 1, num)
    u, v = np.cos(angle) * u + np.sin(angle) * v, np.cos(angle) * v - np.sin(angle) * u
    return make(rng, center, u * radius, v * radius * log_uniform(rng, 0.1, 1, num))


def near_plane(seed=0, num=200):
    """Return discs about the eye: they straddle the near plane and the eye plane, or lie behind it."""
    rng = np.random.default_rng(seed)
    u, v = frames(rng.normal(size=(num, 3)))
    u, v = (t * log_uniform(rng, 0.01, 2, num) for t in (u, v))
    return make(rng, EYE + rng.normal(size=(num, 3)) * 0.2, u, v)


def giant(seed=0, num=60):
    """Return discs up to a thousand times as large as the view, many through the eye plane."""
    rng = np.random.default_rng(seed)
    u, v = frames(rng.normal(size=(num, 3)))
    u, v = (t * log_uniform(rng, 1, 1000, num) for t in (u, v))
    return make(rng, rng.uniform(-3, 3, (num, 3)), u, v)


def sub_pixel(seed=0, num=500):
    """Return discs of 1e-7 to 0.2 pixels in diameter: only the pre-filter keeps them."""
    rng = np.random.default_rng(seed)
    u, v = frames(rng.normal(size=(num, 3)))
    u, v = (t * log_uniform(rng, 1e-7, 5e-3, num) for t in (u, v))
    return make(rng, rng.uniform(-1, 1, (num, 3)), u, v)


def layers(seed=0, num=150):
    """Return nearly facing discs on top of each other, with depths over a few EPSILON."""
    rng = np.random.default_rng(seed)
    u, v = frames(np.array([[0.0, 0, 1]]) + rng.normal(size=(num, 3)) * 0.1)
    center = rng.normal(size=(num, 3)) * [0.4, 0.4, EPSILON]
    radius = log_uniform(rng, 0.1, 0.4, num)
    return make(rng, center, u * radius, v * radius)


def sphere(seed=0, num=400):
    """Return a closed unit sphere of overlapping discs on a Fibonacci lattice, with outward normals."""
    rng = np.random.default_rng(seed)
    i = np.arange(num) + 0.5
    latitude, longitude = np.arccos(1 - 2 * i / num), np.pi * (1 + 5**0.5) * i
    ring = np.sin(latitude)
    center = np.stack([np.cos(longitude) * ring, np.sin(longitude) * ring, np.cos(latitude)], axis=1)
    u, v = frames(center)
    radius = 2 * np.sqrt(4 / num)
    return make(rng, center, u * radius, v * radius)


def edge_on_parallel(seed=0):
    """Return discs that are nearly edge-on to an orthographic camera along z."""
    return edge_on(seed, parallel=True)


def joined(*parts):
    """Return the concatenated discs and colors of several splats."""
    fields = ("center", "tangent_u", "tangent_v", "color")
    return Splats(*(np.concatenate([getattr(part, name) for part in parts]) for name in fields))


ORDINARY = {"random_ellipses": random_ellipses, "layers": layers, "sphere": sphere}
ADVERSARIAL = {
    "thin": thin,
    "edge_on": edge_on,
    "edge_on_parallel": edge_on_parallel,
    "near_plane": near_plane,
    "giant": giant,
    "sub_pixel": sub_pixel,
}
SCENES = ORDINARY | ADVERSARIAL


def extended(scene, seed=0, clip=False, field=False, attributes=()):
    """Return a scene's splats with random clip lines, normal fields and attributes."""
    splats, rng = SCENES[scene](seed), np.random.default_rng(seed)
    num, given = len(splats), {}
    if clip:
        angle = rng.uniform(0, 2 * np.pi, (num, 2))
        given["clip"] = np.stack([np.cos(angle), np.sin(angle), rng.uniform(-0.1, 0.7, (num, 2))], axis=2)
        given["clip"][rng.random(num) < 0.3] = 0
    if field:
        given["normal_du"], given["normal_dv"] = rng.normal(0, 0.4, (2, num, 3))
    named = {name: rng.random(num) * (20 if name == "shininess" else 1) for name in attributes}
    given = {name: array.astype(np.float32) for name, array in given.items()}
    named = {name: array.astype(np.float32) for name, array in named.items()}
    return replace(splats, **given, attributes=named)


_POSE = Camera.look_at((0.4, -0.3, 3.1), (0.1, 0, 0), up=(0.3, 1, 0)).eye_from_world
CAMERAS = {
    "outside": Camera.look_at(EYE, (0, 0, 0), **SIZE),
    "clipped": Camera.look_at(EYE, (0, 0, 0), near=2.625, far=3.375, **SIZE),
    "close": Camera.look_at(EYE, (0, 0, 0), near=0.125, far=3.5, **SIZE),
    "inside": Camera.look_at((0, 0, 0.5), (0.1, 0, -1), near=0.0625, **SIZE),
    "off_center": Camera(_POSE, 71.3, 54.7, 21.9, 30.2, **SIZE),
    "orthographic": Camera.look_at(EYE, (0, 0, 0), near=-10, projection="orthographic", **SIZE),
}

VIEWS = [(s, c) for s in SCENES for c in CAMERAS if (s, c) not in {("near_plane", "clipped"), ("near_plane", "inside")}]
"""Every scene under every camera, without two views that see nothing."""


def any_camera(rng, projection):
    """Return a camera with any scale, depth range and principal point, at the world's origin or far from it."""
    scale, focal = 10.0 ** rng.integers(-5, 7), 100 * 10.0 ** rng.uniform(-1, 1)
    near, far = scale * min(10.0 ** rng.uniform(-6, 1), 2.0), scale * rng.choice([3.0, np.inf])
    if projection == "orthographic":
        focal, near = focal / scale, -scale
    x, y = rng.choice([0, 100, 1e6], p=[0.6, 0.2, 0.2]) * rng.uniform(-1, 1, 2)
    matrix = np.eye(4)
    matrix[2, :3] = rng.normal(size=3)
    matrix[2] /= np.linalg.norm(matrix[2])
    matrix[0, :3], matrix[1, :3] = (u[0] for u in frames(matrix[2, :3]))
    matrix[:3, 3] = rng.normal(size=3) * scale * rng.choice([0, 1, 1e4])
    return Camera(matrix, focal, focal * rng.choice([1, 3]), 48 + x, 32 + y, 97, 61, near, far, projection)


def any_discs(rng, camera, num=250):
    """Return discs of every size, aspect, skew and tilt around the camera's view, its near plane and its eye."""
    near = camera.near if camera.projection == "perspective" else 1 / camera.fx
    z = near * log_uniform(rng, 0.1, 1e4, num)[:, 0]
    z[::4] = near * (1 + rng.choice([-1, 1], len(z[::4])) * log_uniform(rng, 1e-8, 1e-2, len(z[::4]))[:, 0])
    deep = z if camera.projection == "perspective" else np.ones(num)
    raster = rng.uniform(-0.3, 1.3, (num, 2)) * [camera.width, camera.height]
    center = np.column_stack([(raster - [camera.cx, camera.cy]) / [camera.fx, camera.fy] * deep[:, None], z])
    center[::50] = 0
    sight = center + np.array([0, 0, 1e-30]) if camera.projection == "perspective" else np.tile([[0.0, 0, 1]], (num, 1))
    sight /= np.linalg.norm(sight, axis=1, keepdims=True)
    sideways = np.eye(3)[rng.integers(0, 2, num)] + rng.normal(size=(num, 3)) * rng.choice([0, 1], (num, 1))
    across = np.cross(sight, sideways)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    u, v = frames((across + sight * log_uniform(rng, 2.0**-16, 4, num)) * rng.choice([-1, 1], (num, 1)))
    u *= np.where(rng.random(num) < 0.5, deep / camera.fx, z)[:, None] * log_uniform(rng, 1e-3, 1e3, num)
    v *= np.linalg.norm(u, axis=1, keepdims=True) * log_uniform(rng, 1e-6, 1, num)
    v += u * rng.choice([0, 1], (num, 1), p=[0.8, 0.2])
    rotation, position = camera.eye_from_world[:3, :3], camera.position
    center = (center @ rotation + position).astype(rng.choice(["f4", "f8"]))
    return Splats(center, (u @ rotation).astype("f4"), (v @ rotation).astype("f4"), on_invalid="drop")
