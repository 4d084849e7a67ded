"""Supersampling: render n x n samples for each pixel, and average them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from splatcl.oracle.buffers import NO_SPLAT, Array
from splatcl.oracle.geometry.rays import normalize
from splatcl.scene.camera import Camera


def enlarged(camera: Camera, n: int) -> Camera:
    """Return the camera of the same view with n times as many pixels along each side."""
    pixels = {name: n * getattr(camera, name) for name in ("fx", "fy", "cx", "cy", "width", "height")}
    return replace(camera, **pixels)


def averaged(aovs: Mapping[str, Array], n: int) -> dict[str, Array]:
    """Average AOVs (n H, n W, ...) over the n x n samples of each pixel; Z and margins take the least sample."""
    samples = {name: _samples(image, n) for name, image in aovs.items()}
    return {name: _average(name, samples) for name in samples}


def _average(name: str, samples: Mapping[str, Array]) -> Array:
    """Average one AOV, (H, W, n n, ...) to (H, W, ...)."""
    values, nearest = samples[name], samples["Z"].min(axis=2)
    if name == "Z" or name.endswith("margin"):
        return values.min(axis=2)
    if name == "particleid":
        return np.where(samples["Z"] == nearest[:, :, None], values, NO_SPLAT).min(axis=2)
    if name == "count":
        return values.sum(axis=2, dtype=np.uint32)
    if name in ("color", "weight"):
        return values.mean(axis=2)
    if name in ("depth.mean", "depth.distance"):
        there = np.isfinite(values)
        return np.where(there.any(axis=2), _mean(values, there), np.inf)
    mean = _mean(values, samples["weight"] > 0)
    return normalize(mean) if name == "N" else mean


def _samples(image: Array, n: int) -> Array:
    """Gather the samples of each pixel, (n H, n W, ...) to (H, W, n n, ...)."""
    height, width, *rest = image.shape
    blocks = image.reshape(height // n, n, width // n, n, *rest).swapaxes(1, 2)
    return blocks.reshape(height // n, width // n, n * n, *rest)


def _mean(samples: Array, there: Array) -> Array:
    """Average (H, W, S, ...) over the samples where `there` (H, W, S) is true; 0 for a pixel without any."""
    while there.ndim < samples.ndim:
        there = there[..., None]
    return np.where(there, samples, 0).sum(axis=2) / np.maximum(there.sum(axis=2), 1)
