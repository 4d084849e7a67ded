"""The visibility pass: every splat against every pixel."""

from __future__ import annotations

import numpy as np

from splatcl.camera import Camera
from splatcl.oracle.buffers import NO_SPLAT, DepthBuffer, ProjectedSplats
from splatcl.oracle.geometry.fragments import _Raster
from splatcl.oracle.geometry.rays import UNIT, _chunks, _image
from splatcl.settings import RenderSettings


def visibility(projected: ProjectedSplats, camera: Camera, settings: RenderSettings) -> DepthBuffer:
    """Find the front-most disc at each pixel: depth = min z over r3 <= 1; ties go to the lower index.

    For the other footprints over the ellipse, without its low-pass filter.
    """
    num_pixels = camera.height * camera.width
    depth, margin, id_margin = (np.full(num_pixels, np.inf) for _ in range(3))
    particleid = np.full(num_pixels, NO_SPLAT)
    raster = _Raster.of(projected, camera, settings)
    for pixels, s in _chunks(camera, len(projected.center_eye)):
        f = raster.covered(s[:, None])
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
    return DepthBuffer(*(_image(buffer, camera) for buffer in buffers))
