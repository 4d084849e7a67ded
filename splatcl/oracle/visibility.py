"""Visibility pass: find the front-most splat at every pixel ([BHZK05])."""

from __future__ import annotations

import numpy as np

from splatcl.oracle.buffers import NO_SPLAT, DepthBuffer, ProjectedSplats
from splatcl.oracle.geometry.fragments import Footprints
from splatcl.oracle.geometry.rays import UNIT, as_image, pixel_chunks
from splatcl.scene.camera import Camera
from splatcl.scene.settings import RenderSettings


def visibility(projected: ProjectedSplats, camera: Camera, settings: RenderSettings) -> DepthBuffer:
    """Find the front-most splat at each pixel: depth(p) = min z over r3 <= 1; ties go to the lower index.

    The affine and the conic footprint take r of their ellipse, without its low-pass filter, for r3.
    """
    num_pixels = camera.height * camera.width
    depth, margin, id_margin = (np.full(num_pixels, np.inf) for _ in range(3))
    particleid = np.full(num_pixels, NO_SPLAT)
    footprints = Footprints.of(projected, camera, settings)
    for pixels, s in pixel_chunks(camera, len(projected.center_eye)):
        f = footprints.visibility_fragments(s[:, None])
        z = np.where(f.r_squared <= 1, f.z, np.inf)
        front = z.argmin(axis=1, keepdims=True)
        nearest = np.take_along_axis(z, front, axis=1)
        depth[pixels] = nearest[:, 0]
        particleid[pixels] = np.where(np.isfinite(nearest), front, NO_SPLAT)[:, 0]
        margin[pixels] = f.margin.min(axis=1)
        with np.errstate(invalid="ignore", over="ignore"):
            gap = (z - nearest) / (UNIT * (f.scale_z + np.take_along_axis(f.scale_z, front, axis=1)))
        gap[z == np.inf] = np.inf
        np.put_along_axis(gap, front, np.inf, axis=1)
        id_margin[pixels] = gap.min(axis=1)
    buffers = (depth, particleid, np.minimum(margin, id_margin), margin)
    return DepthBuffer(*(as_image(buffer, camera) for buffer in buffers))
