"""Sums for the shading pass, and the oracle's results for them."""

from __future__ import annotations

import numpy as np
from helpers.device_passes import DevicePasses
from helpers.scenes import SIZE, frames, random_ellipses
from tolerances import SHADED_DOUBLE, SHADED_SINGLE

from splatcl import Splats
from splatcl.oracle.buffers import DepthBuffer, GBuffer
from splatcl.oracle.shade import shade

SHAPE = SIZE["height"], SIZE["width"]


TOLERANCE = {"single": SHADED_SINGLE, "double": SHADED_DOUBLE}


def make_sums(seed=0):
    """Return float32 sums that the attribute pass could write: empty, disc and pre-filter-only pixels."""
    rng = np.random.default_rng(seed)
    weight = rng.uniform(0.1, 5, SHAPE)
    state = rng.integers(0, 6, SHAPE)  # 0: empty; 1: only pre-filter fragments; above: a disc is hit
    weight[(state == 0) | (state == 5)] = 0  # a hit disc may have weight 0: a table may end in zeros
    normal = rng.normal(size=(*SHAPE, 3))
    depth = np.where(state >= 2, rng.uniform(1, 5, SHAPE), np.inf)
    sums = {
        "depth": depth,
        "weight_sum": weight,
        "color_sum": weight[..., None] * rng.uniform(0, 1, (*SHAPE, 3)),
        "normal_sum": weight[..., None] * normal / np.linalg.norm(normal, axis=-1, keepdims=True),
        "depth_sum": weight * rng.uniform(1, 5, SHAPE),
    }
    sums["normal_sum"][state == 4] *= 0.01  # opposite normals nearly cancel
    sums["normal_sum"][0, :3] = 0  # opposite normals cancel exactly
    return {name: array.astype(np.float32) for name, array in sums.items()}


def expected(sums, camera, settings):
    """Return the oracle's result for the sums, with contours by the settings' own epsilon."""
    exact = {name: array.astype(np.float64) for name, array in sums.items()}
    depth = DepthBuffer(exact.pop("depth"), *[np.zeros(SHAPE)] * 3)
    gbuffer = GBuffer(**exact, count=np.zeros(SHAPE), margin=np.zeros(SHAPE))
    return shade(gbuffer, depth, camera, settings, settings.epsilon)


def both(device, camera, settings, sums):
    """Return the device's and the oracle's results for the same sums."""
    got = DevicePasses(device, random_ellipses(num=3), camera, settings).shade(sums)
    return got, expected(sums, camera, settings)


def one_disc(normal, color=(0.5, 0.25, 1.0), z=4.0):
    """Return a big disc with the given normal, on the axis of a camera at the origin."""
    u, v = frames(normal)
    return Splats([[0, 0, z]], 3 * u, 3 * v, color=[color])
