"""Build the scenes of the reference images. Each pins a rule of docs/specification.md.

`SCENES` names the builders. Colors are linear RGB. Numbers are rounded to float32 unless a scene says otherwise.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from scene_files import Scene
from scene_shapes import discs, fibonacci_sphere, grid, hue, splats, unit

from splatcl import Camera, Light, Material, RenderSettings, Splats, read
from splatcl.prepare.points import splats_from_points

SCAN = Path(__file__).parent / "scans" / "bunny.pts"
KEEP_EVERY = 8
"""Step through the scan's 30 571 points."""

GOLD, BLUE, CREAM, TEAL, WHITE = (0.9, 0.55, 0.08), (0.03, 0.12, 0.75), (0.85, 0.78, 0.6), (0.0, 0.16, 0.2), (0.9,) * 3
ALBEDO = {"shader": "albedo"}


def facing_disc() -> Scene:
    """Put center and rim on pixel centers: z = 2, a radius of 20 pixels, every number a short binary fraction."""
    return Scene(
        "One facing disc of 20 pixels' radius about a pixel center, lit by a point light. The rim belongs to the "
        "splat, so it covers 1257 pixels, twelve of them exactly on the rim. Its weight falls from 1 to e^-2.",
        splats([[0, 0, 2]], [[0.625, 0, 0]], [[0, -0.625, 0]], GOLD),
        Camera(np.eye(4), 64, 64, 32.5, 32.5, 64, 64),
        RenderSettings(epsilon=0, lights=(Light("point", (0.5, -0.5, 1.5)),), material=Material(0.1, 0.9, 0.2, 16)),
    )


def checkerboard() -> Scene:
    """Lay a floor of 42 x 46 overlapping discs, 0.125 apart."""
    x, z = grid(np.arange(-2.5625, 2.6, 0.125), np.arange(-3.4375, 2.2, 0.125))
    center = np.stack([x, 0 * x, z], axis=1)
    dark = (np.floor(x / 0.5) + np.floor(z / 0.5)) % 2 == 1
    return Scene(
        "A floor of overlapping discs with the colors of a checkerboard. Weights blend colors only at the squares' "
        "edges, perspective is exact per pixel, and the pre-filter keeps the far discs, which are smaller than a "
        "pixel.",
        discs(center, [[0, 1, 0]], 0.1, np.where(dark[:, None], TEAL, CREAM)),
        Camera.look_at((0.6, 0.9, 3.0), (0.1, 0, 0), width=88, height=56, fov_y=40),
        RenderSettings(epsilon=0.125, **ALBEDO),
    )


def epsilon_layers() -> Scene:
    """Hang a gold sheet at z = 4, and five blue discs behind it; epsilon, 1/4, reaches exactly to the middle disc."""
    behind = 0.25 * np.array([0.5, 1 - 2**-8, 1, 1 + 2**-8, 1.5])
    blue = np.stack([np.linspace(-1.7, 1.7, 5), np.full(5, 0.2), 4 + behind], axis=1)
    x, y = grid(np.arange(-2.25, 2.3, 0.25), np.arange(-2.0, 0.1, 0.25))
    gold = np.stack([x, y, np.full(len(x), 4)], axis=1)
    return Scene(
        "A gold sheet, and blue discs behind it at 1/2, 255/256, 1, 257/256 and 3/2 epsilon. The first three blend "
        "with it, because the limit is inclusive. The other two show only below it.",
        discs(
            np.concatenate([gold, blue]),
            [[0, 0, -1]],
            np.repeat([0.25, 0.4], [len(gold), 5]),
            np.repeat([GOLD, BLUE], [len(gold), 5], axis=0),
        ),
        Camera(np.eye(4), 72, 72, 40, 32, 80, 48),
        RenderSettings(epsilon=0.25, **ALBEDO),
    )


def epsilon_along_ray() -> Scene:
    """Hang two sheets 0.8 epsilon apart before a wide-angle camera."""
    x, y = grid(np.arange(-1.5, 1.6, 0.25), np.arange(-1.5, 1.6, 0.25))
    gold, blue = (np.stack([x, y, np.full(len(x), z)], axis=1) for z in (1.0, 1.2))
    return Scene(
        "Two sheets 0.8 epsilon apart along z under a wide angle, with epsilon along the ray. The blue sheet behind "
        "blends only where the rays are steep enough: |d| <= 1.25, inside a circle of 24 pixels' radius.",
        discs(
            np.concatenate([gold, blue]), [[0, 0, -1]], 0.25, np.repeat([GOLD, BLUE], [len(gold), len(blue)], axis=0)
        ),
        Camera(np.eye(4), 32, 32, 32, 32, 64, 64),
        RenderSettings(epsilon=0.25, along="ray", **ALBEDO),
    )


def edge_on() -> Scene:
    """Lay rows of ellipses that turn away from the eye about one axis, about the other, and that narrow."""
    turns, narrow = np.radians([0, 30, 55, 70, 80, 86, 89, 89.9, 90]), 2.0 ** -np.arange(9)
    turned, still = np.stack([np.cos(turns), np.sin(turns)]), np.stack([np.ones(9), np.zeros(9)])
    rows = (
        (-0.75, 0.15 * turned, 0.3 * still),
        (0, 0.15 * still, 0.3 * turned),
        (0.75, 0.15 * narrow * still, 0.3 * still),
    )
    center, t_u, t_v = [], [], []
    for y, u, v in rows:
        for i, x in enumerate(np.linspace(-1.35, 1.35, 9)):
            c = np.array([x, y, 3 + 0.2 * x])
            right = unit(np.cross(c, [-0.4, 1, 0]))
            up = unit(np.cross(right, c))
            center.append(c)
            t_u.append(u[0, i] * right + u[1, i] * unit(c))
            t_v.append(v[0, i] * up + v[1, i] * unit(c))
    return Scene(
        "Ellipses that turn edge-on from left to right, about their long axis and about their short axis; below, "
        "needles each half as wide as the last. A disc covers the pixel centers inside it, however thin it is. A "
        "disc that contains no pixel center, like an edge-on one, shows only the pre-filter's dot: here of 1.5 "
        "pixels' radius about the center of the projected bounds.",
        splats(center, t_u, t_v, hue(np.tile(np.linspace(0, 0.7, 9), 3))),
        Camera(np.eye(4), 80, 80, 49, 36, 92, 72),
        RenderSettings(epsilon=0, prefilter_center="bounds", prefilter_radius=1.5, **ALBEDO),
    )


def near_plane() -> Scene:
    """Build a corridor of four discs centered behind the eye, and three small discs at the near plane."""
    center = [
        [0, 0.8, -1],
        [0, -0.8, -1],
        [-1, 0, -2],
        [1, 0, -2],
        [-0.2, 0.1, 0.24],
        [0.02, -0.13, 0.26],
        [0.2, 0.1, 0.2],
    ]
    t_u = [[3, 0, 0], [3, 0, 0], [0, 2, 0], [0, 2, 0], [0.1, 0, 0], [0.1, 0.02, 0], [0.02, 0.1, 0.02]]
    t_v = [[0, 0, 7], [0, 0, -7], [0, 0, -8], [0, 0, 8], [0, -0.05, 0.1], [0, 0.06, 0.1], [-0.05, 0, 0.12]]
    return Scene(
        "A corridor of four discs whose centers lie behind the eye, and three small discs that the near plane (z = "
        "0.25) cuts in straight lines. The visible part of every splat is drawn, with its depth exact per pixel.",
        splats(center, t_u, t_v, [CREAM, TEAL, (0.6, 0.1, 0.1), (0.1, 0.4, 0.12), GOLD, BLUE, WHITE]),
        Camera(np.eye(4), 44, 44, 44, 32, 88, 64, near=0.25),
        RenderSettings(epsilon=0, facing="flip", material=Material(0.35, 0.65, 0, 1)),
    )


def ringed_planet() -> Scene:
    """Surround a planet of discs with a ring of 1100 dots of a hundredth of a pixel."""
    rng = np.random.default_rng(6)
    angle, distance = rng.uniform(0, 2 * np.pi, 1100), np.sqrt(rng.uniform(1.4**2, 2.1**2, 1100))
    ring = np.stack([distance * np.cos(angle), rng.normal(size=1100) * 0.01, distance * np.sin(angle)], axis=1)
    planet = fibonacci_sphere(260)
    return Scene(
        "A planet with a ring of dots far smaller than a pixel. The pre-filter draws each dot about its center with "
        "the center's depth. Dots in front of the planet blend with it, and dots behind it do not show. Z stays "
        "infinite where only dots are.",
        discs(
            np.concatenate([planet, ring]),
            np.concatenate([planet, np.tile([[0, 1, 0]], (len(ring), 1))]),
            np.repeat([0.2, 3e-4], [len(planet), len(ring)]),
            np.concatenate(
                [np.where(np.abs(planet[:, 1:2] - 0.1) < 0.25, GOLD, CREAM), hue(0.55 + 0.1 * (distance - 1.4))]
            ),
        ),
        Camera.look_at((0, 2.2, 6.5), (0, 0, 0), up=(0.3, 1, 0), fov_y=32, width=88, height=64),
        RenderSettings(
            epsilon=0.05, lights=(Light("directional", (-0.5, 0.8, 0.6)),), material=Material(0.3, 0.9, 0, 1)
        ),
    )


def peeled_sphere() -> Scene:
    """Peel spiral stripes off a sphere, without pre-filter and back faces."""
    p = fibonacci_sphere(900)
    longitude = np.arctan2(p[:, 0], p[:, 2])
    p = p[np.sin(3 * longitude + 5 * p[:, 1]) > -0.4]
    return Scene(
        "A sphere peeled in spiral stripes, with back faces culled and no pre-filter. The gaps are transparent, "
        "because the far side's discs were dropped before the visibility pass. Discs at the silhouette thin to "
        "nothing.",
        discs(p, p, 0.085, hue(0.5 + 0.5 * p[:, 1]) * 0.8 + 0.1),
        Camera.look_at((0.8, 0.9, 3.2), (0, 0, 0), fov_y=40, width=72, height=72),
        RenderSettings(epsilon=0.05, prefilter="none", facing="cull", material=Material(0.2, 0.8, 0.2, 24)),
    )


def orthographic() -> Scene:
    """Stack four unit cubes, three of them below one, before a camera on the diagonal."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 0, 1], [0, 1, 0]], float)
    a, b = (coordinate + 0.1 for coordinate in grid(np.arange(5) / 5, np.arange(5) / 5))
    center, normal = [], []
    for axis in range(3):
        face = np.insert(np.stack([a, b], axis=1), axis, 1.0, axis=1)
        for corner in corners:
            if not (corners == corner + np.eye(3)[axis]).all(axis=1).any():
                center.append(corner + face)
                normal.append(np.tile(np.eye(3)[axis], (len(face), 1)))
    center = np.concatenate(center)
    color = np.where(center[:, 1:2] > 1, GOLD, np.where(center[:, :1] > 1, BLUE, TEAL))
    right, up = unit(np.array([1, 0, -1])), unit(np.array([-1, 2, -1]))
    target = [0.7, 0.7, 0.7] - 1.1 * right - 1.2 * up
    return Scene(
        "Cubes on top of each other under an orthographic camera whose principal point is far from the image's "
        "center. Parallel edges stay parallel, near and far cubes are equally large, and depth is along z.",
        discs(center, np.concatenate(normal), 0.145, color),
        Camera(
            Camera.look_at(target + 8, target).eye_from_world, 21.5, 21.5, 12.25, 61.75, 72, 72, 1, 40, "orthographic"
        ),
        RenderSettings(
            epsilon=0.04, lights=(Light("directional", (0.25, 1.0, 0.6)),), material=Material(0.15, 1.1, 0, 1)
        ),
    )


def three_lights() -> Scene:
    """Turn half of the normals of a torus inward at random."""
    u, v = grid(np.arange(64) / 64 * 2 * np.pi, np.arange(22) / 22 * 2 * np.pi)
    u = u + v / 64
    out = np.stack([np.cos(u), 0 * u, np.sin(u)], axis=1)
    normal = np.cos(v)[:, None] * out + np.sin(v)[:, None] * [0, 1, 0]
    sign = np.random.default_rng(9).choice([-1, 1], (len(u), 1))
    return Scene(
        "A gray torus under a dim headlight, a blue directional light and an orange point light, with highlights. "
        "Half of its normals are turned inward at random, and the settings flip them toward the eye. It is as "
        "smooth as if no normal had been turned, because Phong is evaluated once per pixel.",
        discs(out + 0.42 * normal, sign * normal, 0.1, (0.5, 0.5, 0.5)),
        Camera.look_at((0, 2.9, 2.9), (0, -0.05, 0), fov_y=40, width=88, height=64),
        RenderSettings(
            epsilon=0.05,
            prefilter="none",
            facing="flip",
            lights=(
                Light("headlight", color=(0.15, 0.15, 0.15)),
                Light("directional", (-1, 0.7, -0.3), (0.2, 0.45, 1.0)),
                Light("point", (1.2, 1.6, 1.2), (1.0, 0.5, 0.15)),
            ),
            material=Material(0.04, 0.9, 0.6, 24),
        ),
    )


def kernel_table() -> Scene:
    """Overlap discs in three primary colors in one plane."""
    angle = np.radians([90, 210, 330])
    center = np.stack([0.45 * np.cos(angle), -0.45 * np.sin(angle) + 0.1, np.full(3, 2)], axis=1)
    return Scene(
        "Three discs in one plane, weighted by a table of six samples that is read nearest. Each change of color is "
        "a step of the table at r = (i + 1/2) / 5. Where its last sample, zero, is alone, nothing is drawn although "
        "Z is finite.",
        discs(center, [[0, 0, -1]], 0.75, [(0.9, 0.05, 0.05), (0.05, 0.7, 0.05), (0.05, 0.1, 0.9)]),
        Camera(np.eye(4), 52, 52, 36, 36, 72, 72),
        RenderSettings(
            epsilon=0.01, kernel="table", kernel_table=(1, 0.5, 0.8, 0.3, 0.1, 0), kernel_lookup="nearest", **ALBEDO
        ),
    )


def survey() -> Scene:
    """Survey a hilly field of 36 x 36 m in UTM meters; only the centers are float64."""
    east, north = grid(np.arange(36.0), np.arange(36.0))
    height = 3 * np.sin(east / 5) * np.cos(north / 7) + np.exp(-((east - 22) ** 2 + (north - 20) ** 2) / 30) * 8
    bump = (height - 3 * np.sin(east / 5) * np.cos(north / 7)) / 15
    slope_east = 0.6 * np.cos(east / 5) * np.cos(north / 7) - bump * (east - 22)
    slope_north = -3 / 7 * np.sin(east / 5) * np.sin(north / 7) - bump * (north - 20)
    part = np.clip((height + 2.5) / 9, 0, 1)[:, None]
    color = np.where(part < 0.6, (0.08, 0.25, 0.05) + part * [0.4, 0.15, 0.1], (0.75, 0.75, 0.8))
    field = discs(
        np.zeros((len(east), 3)), np.stack([-slope_east, -slope_north, np.ones(len(east))], axis=1), 1.05, color
    )
    origin = np.array([500_000.0, 4_649_776.0, 120.0])
    eye, target = np.add(origin, (30, -22, 22)), np.add(origin, (18, 17, 0))
    center = np.round((origin + np.stack([east, north, height], axis=1)) * 4096) / 4096
    return Scene(
        "A hilly field in UTM meters, in double precision. float32 would round its northings to half meters; "
        "float64 centers are kept from the file to the pixel.",
        Splats(center, field.tangent_u, field.tangent_v, field.color),
        Camera.look_at(eye, target, up=(0, 0, 1), fov_y=38, width=88, height=64),
        RenderSettings(
            precision="double", lights=(Light("directional", (-1, 0.2, 0.8)),), material=Material(0.15, 1.0, 0, 1)
        ),
    )


def bunny() -> Scene:
    """Decimate the bundled scan of bare points, whose unsigned normals and radii are estimated."""
    points = read(SCAN).center[::KEEP_EVERY].astype(np.float32)
    scan = splats_from_points(points)
    return Scene(
        "Every eighth point of the Stanford Bunny, with estimated normals and radii and the default settings. The "
        "irregular ellipses of a scan close the surface, and normals without sign turn toward the viewer.",
        Splats(
            points,
            scan.tangent_u.astype(np.float32),
            scan.tangent_v.astype(np.float32),
            oriented=False,
            notes=scan.notes,
        ),
        Camera.framing(scan.bounding_sphere, azimuth=20, elevation=10, fov_y=32, width=80, height=80),
        RenderSettings(),
    )


SCENES: dict[str, Callable[[], Scene]] = {
    builder.__name__: builder
    for builder in (
        facing_disc, checkerboard, epsilon_layers, epsilon_along_ray, edge_on, near_plane, ringed_planet, peeled_sphere,
        orthographic, three_lights, kernel_table, survey, bunny,
    )
}  # fmt: skip
