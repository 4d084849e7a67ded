"""Small cameras and discs for the tests of the oracle, and a linear solver that shares no code with it."""

from __future__ import annotations

import numpy as np

from splatcl import Camera, RenderSettings, Splats, oracle

UNIT = 2.0**-24
NONE = 0xFFFFFFFF
PROJECTIONS = ("perspective", "orthographic")


def camera(size=33, f=32.0, pose=None, **kwargs):
    """Return a camera at the origin that looks along +z; with an odd size the middle pixel looks straight ahead."""
    arguments = {"fx": f, "fy": f, "cx": size / 2, "cy": size / 2, "width": size, "height": size, "near": 0.01}
    return Camera(np.eye(4) if pose is None else pose, **{**arguments, **kwargs})


def discs(*rows, **kwargs):
    """Return splats from (center, tangent_u, tangent_v) rows."""
    center, t_u, t_v = (np.array(column, np.float64) for column in zip(*rows, strict=True))
    return Splats(center, t_u, t_v, **kwargs)


def facing_disc(z=2.0, radius=1.0, x=0.0, y=0.0):
    """Return the center and tangents of a disc of constant z, with its normal along -z, toward the eye."""
    return (x, y, z), (0, radius, 0), (radius, 0, 0)


def render(splats, view, **kwargs):
    return oracle.render(splats, view, RenderSettings(**{"prefilter": "none", **kwargs}))


def rays(view):
    """Return (H, W, 2) s = (x - c) / f of the pixel centers."""
    x, y = np.meshgrid(np.arange(view.width) + 0.5, np.arange(view.height) + 0.5)
    return np.stack([(x - view.cx) / view.fx, (y - view.cy) / view.fy], axis=-1)


def solve(view, center, t_u, t_v):
    """Return (H, W, 3) u, v, z of one disc, by a 3x3 solve of c + u t_u + v t_v = o + z d at each pixel."""
    s = rays(view)
    eye = view.eye_from_world
    center = eye[:3, :3] @ center + eye[:3, 3]
    one, zero = np.ones(s.shape[:2]), np.zeros(s.shape[:2])
    if view.projection == "perspective":
        origin, direction = np.stack([zero, zero, zero], -1), np.stack([s[..., 0], s[..., 1], one], -1)
    else:
        origin, direction = np.stack([s[..., 0], s[..., 1], zero], -1), np.stack([zero, zero, one], -1)
    columns = [np.broadcast_to(eye[:3, :3] @ t, direction.shape) for t in (t_u, t_v)]
    return np.linalg.solve(np.stack([*columns, -direction], -1), (origin - center)[..., None])[..., 0]


def random_rotation(rng):
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q * np.sign(np.linalg.det(q))


def random_splats(rng, num, size=0.3, z=(-0.5, 4.0), spread=1.0):
    """Return random ellipses around the view axis, some behind the eye or through its plane."""
    depth = rng.uniform(*z, num)
    center = np.column_stack([rng.uniform(-spread, spread, (num, 2)) * np.abs(depth)[:, None], depth])
    frames = np.stack([random_rotation(rng) for _ in range(num)])
    radii = size * np.exp(rng.normal(0, 0.7, (num, 2)))
    return Splats(center, frames[:, 0] * radii[:, :1], frames[:, 1] * radii[:, 1:], rng.random((num, 3)))
