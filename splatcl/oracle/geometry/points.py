"""Square points, the sprites in which [BHZK05] section 3 draws its discs."""

from __future__ import annotations

import numpy as np

from splatcl.oracle.buffers import Array
from splatcl.scene.camera import Camera
from splatcl.scene.settings import RenderSettings


def point_half(t_u: Array, t_v: Array, z: Array, camera: Camera, settings: RenderSettings, filtered: bool) -> Array:
    """Return half the side of each splat's point, (N,) pixels: r f_y / z for the larger radius r.

    `filtered` enlarges it to the radius of the pre-filter "min". `t_u` and `t_v` are (N, 3) in eye space, `z` is (N,).
    """
    longest = np.maximum(np.linalg.norm(t_u, axis=1), np.linalg.norm(t_v, axis=1))
    with np.errstate(divide="ignore"):
        half = longest * camera.fy / (z if camera.projection == "perspective" else 1)
    return np.maximum(half, settings.prefilter_radius) if filtered and settings.prefilter == "min" else half
