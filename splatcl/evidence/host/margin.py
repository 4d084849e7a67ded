"""Margins on the host, in float64 (NumPy)."""

from __future__ import annotations

import numpy as np

from splatcl.evidence.host.pairs import MAX_MARGIN, Array, bands, decisions, fragments
from splatcl.oracle.project import project
from splatcl.scene.camera import Camera
from splatcl.scene.settings import RenderSettings
from splatcl.scene.splats import Splats


def margin(splats: Splats, camera: Camera, settings: RenderSettings, epsilon: float) -> tuple[Array, Array]:
    """Return each pixel's margin: the distance of its nearest decision from flipping.

    Parameters
    ----------
    splats, camera, settings
        As for `render`; under `half_inputs` the splats must be rounded already.
    epsilon : float
        Depth tolerance of the render, scene units.

    Returns
    -------
    margin : (H, W) float32
        In units of the decision's own float32 rounding error (splatcl/oracle), at most `MAX_MARGIN`.
    raw : (H, W) float32
        Distance of the same decision: of r from 1, or of z from its limit in scene units. It is +inf where the margin
        is `MAX_MARGIN`.
    """
    shape = (camera.height, camera.width)
    units, raw = np.full(shape[0] * shape[1], MAX_MARGIN), np.full(shape[0] * shape[1], np.inf)
    projected = project(splats, camera, settings)
    for pairs in bands(projected, camera, settings):
        f = fragments(pairs, projected, camera, settings, epsilon)
        nearest, distance = decisions(pairs, f)
        best = pairs.least(nearest)
        is_best = nearest == best[pairs.run]
        units[pairs.pixel] = np.minimum(best, MAX_MARGIN)
        raw[pairs.pixel] = np.where(best < MAX_MARGIN, pairs.least(np.where(is_best, distance, np.inf)), np.inf)
    return units.reshape(shape).astype(np.float32), raw.reshape(shape).astype(np.float32)
