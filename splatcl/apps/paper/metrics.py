"""Differences of two images, and other measures of images."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splatcl.errors import SplatclError
from splatcl.io.png import to_srgb8

Array = NDArray[Any]
PEAK = 1.0
"""The value of white."""
NO_FLIP = "FLIP was not measured: pip install 'splatcl[paper]'."
FLIP_SCRIPT = """
import sys, numpy, flip_evaluator
reference, image = numpy.load(sys.argv[1])
print(flip_evaluator.evaluate(reference, image, "LDR", applyMagma=False)[1])
"""
FLIP_SECONDS = 120


def differences(image: Array, reference: Array, mask: Array) -> tuple[float, float]:
    """Return the largest and the mean absolute difference of two (H, W, ...) images over an (H, W) mask."""
    apart = np.abs(image[mask].astype(np.float64) - reference[mask])
    return (float(apart.max()), float(apart.mean())) if apart.size else (0.0, 0.0)


def psnr(image: Array, reference: Array, mask: Array | None = None) -> float:
    """Return the peak signal-to-noise ratio, dB, of (H, W, 3) images whose white is 1; inf if they are equal.

    `mask` (H, W) selects the pixels that count; all by default.
    """
    where = np.ones(image.shape[:2], bool) if mask is None else mask
    error = float(np.mean(np.square(image[where].astype(np.float64) - reference[where])))
    return float(-10 * np.log10(error / PEAK**2)) if error else float("inf")


def ssim(image: Array, reference: Array) -> float:
    """Return the mean structural similarity of (H, W, 3) images whose white is 1: Gaussian window, sigma 1.5."""
    from skimage import metrics

    measure: Any = metrics.structural_similarity
    images = image.astype(np.float64), reference.astype(np.float64)
    options = {"data_range": PEAK, "channel_axis": 2, "gaussian_weights": True, "use_sample_covariance": False}
    return float(measure(*images, **options))


def flip(image: Array, reference: Array) -> float | None:
    """Return the mean FLIP error, 0 ... 1, of (H, W, 3) linear images on a display of 67 pixels a degree.

    It is None without the package flip-evaluator. The package runs in a process of its own, because it ends the process
    when it rejects an image. `SplatclError` is raised if it fails.
    """
    if find_spec("flip_evaluator") is None:
        return None
    if not (np.isfinite(image).all() and np.isfinite(reference).all()):
        raise SplatclError("FLIP compares finite images only")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "images.npy"
        np.save(path, np.stack([srgb(reference), srgb(image)]))
        command = [sys.executable, "-c", FLIP_SCRIPT, str(path)]
        done = subprocess.run(command, capture_output=True, text=True, timeout=FLIP_SECONDS, check=False)
    if done.returncode:
        raise SplatclError(f"FLIP failed: {(done.stderr or done.stdout).strip().splitlines()[-1:]}")
    return float(done.stdout)


def srgb(color: Array) -> NDArray[np.float32]:
    """Return (H, W, 3) linear RGB as float sRGB of 256 levels, clamped to [0, 1]."""
    opaque = np.concatenate([color, np.ones((*color.shape[:2], 1))], axis=2)
    return to_srgb8(opaque)[..., :3].astype(np.float32) / np.float32(255)


def box_filtered(image: Array, n: int) -> Array:
    """Return the (H, W, ...) means of the n x n blocks of an (n H, n W, ...) image."""
    height, width = image.shape[0] // n, image.shape[1] // n
    return image.reshape(height, n, width, n, *image.shape[2:]).mean(axis=(1, 3))


def num_levels(values: Array) -> int:
    """Return the number of different values."""
    return len(np.unique(values))


def angles(normals: Array, reference: Array) -> Array:
    """Return the (N,) angles, degrees, between (N, 3) unit vectors."""
    crossed = np.linalg.norm(np.cross(normals.astype(np.float64), reference), axis=1)
    return np.degrees(np.arctan2(crossed, np.sum(normals * reference, axis=1, dtype=np.float64)))


def area(weight: Array) -> int:
    """Return the number of pixels with a weight above 0."""
    return int(np.count_nonzero(weight))


def second_moments(weight: Array) -> Array:
    """Return the (2, 2) central second moments of (H, W) weights, square pixels, in the order x, y."""
    y, x = np.indices(weight.shape) + 0.5
    total = weight.sum(dtype=np.float64)
    offsets = np.stack([axis - (weight * axis).sum(dtype=np.float64) / total for axis in (x, y)])
    return np.einsum("hw,ihw,jhw->ij", weight, offsets, offsets) / total
