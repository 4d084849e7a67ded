"""Compare AOVs bit by bit, and show where they differ."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from skimage.metrics import peak_signal_noise_ratio, structural_similarity

from splatcl.io.png import write_png

FAINTEST = 0.3
"""Brightness of the least difference in a difference picture; the largest is 1, and equal pixels are black."""


@dataclass(frozen=True, eq=False)
class Difference:
    """The difference of one AOV from its reference: (H, W) bool `where`, and (H, W) `magnitude` over the channels.

    The magnitude is infinite where NaN or an infinity differs from anything else. It is 0 where only the sign of a zero
    or the bits of a NaN differ.
    """

    where: np.ndarray
    magnitude: np.ndarray

    @property
    def num_pixels(self):
        return int(np.count_nonzero(self.where))

    @property
    def largest(self):
        return float(self.magnitude.max(initial=0.0))


def as_stored(aov):
    """Return an AOV in the type that EXR stores: uint32, or float32 (from float64 kernels too)."""
    return np.ascontiguousarray(aov, np.uint32 if np.asarray(aov).dtype.kind in "ui" else np.float32)


def difference(got, reference):
    """Compare two arrays of one AOV, (H, W) or (H, W, C), bit by bit."""
    got, reference = as_stored(got), as_stored(reference)
    assert got.shape == reference.shape, f"shape {got.shape} against {reference.shape}"
    assert got.dtype == reference.dtype, f"{got.dtype} against {reference.dtype}"
    where = got.view(np.uint32) != reference.view(np.uint32)
    with np.errstate(invalid="ignore", over="ignore"):
        magnitude = np.abs(got.astype(np.float64) - reference)
    both_nan = np.isnan(got) & np.isnan(reference)
    magnitude = np.where(where & ~both_nan, np.where(np.isnan(magnitude), np.inf, magnitude), 0.0)
    if where.ndim == 3:
        where, magnitude = where.any(axis=-1), magnitude.max(axis=-1)
    return Difference(where, magnitude)


def differences(got, reference):
    """Return the differences by AOV, where there are any; both must have the same AOVs."""
    assert set(got) == set(reference), f"AOVs {sorted(got)} against {sorted(reference)}"
    found = {name: difference(got[name], reference[name]) for name in reference}
    return {name: d for name, d in found.items() if d.num_pixels}


def similarity(got, reference):
    """Return PSNR in dB and SSIM of two (H, W, 4) linear pictures; NaN is black, highlights are clipped alike."""
    finite = reference[np.isfinite(reference)]
    white = float(finite.max(initial=1.0))
    got, reference = (np.clip(np.nan_to_num(np.asarray(c, np.float64)), 0.0, white) for c in (got, reference))
    with np.errstate(divide="ignore"):
        psnr = peak_signal_noise_ratio(reference, got, data_range=white)
    return float(psnr), float(structural_similarity(reference, got, data_range=white, channel_axis=-1))


def picture(d):
    """Return a (H, W, 4) linear RGBA picture: black where equal, brighter where the difference is larger."""
    largest = d.magnitude[np.isfinite(d.magnitude)].max(initial=0.0)
    size = np.clip(np.nan_to_num(d.magnitude / (largest or 1.0), posinf=1.0), 0.0, 1.0)
    gray = np.where(d.where, FAINTEST + (1 - FAINTEST) * size, 0.0)
    return np.stack([gray, gray, gray, np.ones(gray.shape)], axis=-1)


def report(name, got, reference, found, folder):
    """Write pictures of the differences of a frame `got` under `folder`; return the text that describes them.

    The files are got.exr, got.png, reference.png, and difference_AOV.png for each AOV of `found` (from `differences`).
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    for old in folder.glob("difference_*.png"):
        old.unlink()
    got.save(folder / "got.exr")
    write_png(folder / "got.png", as_stored(got.color))
    write_png(folder / "reference.png", reference["color"])
    for aov, d in found.items():
        write_png(folder / f"difference_{aov}.png", picture(d))
    psnr, ssim = similarity(got.color, reference["color"])
    lines = [f"{aov}: {d.num_pixels} of {d.where.size} pixels, by at most {d.largest:.3g}" for aov, d in found.items()]
    lines += [f"the shaded image's PSNR is {psnr:.2f} dB, its SSIM {ssim:.6f}", f"pictures: {folder}"]
    return "\n  ".join([f"{name} is not its reference image:", *lines])
