"""A frame's color as an 8-bit sRGB PNG with straight alpha."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splatcl.errors import SettingsError
from splatcl.util.atomic import atomic_path

MAX_EXPOSURE = 100.0
"""Largest absolute exposure, stops."""
BAND = 256
"""Rows converted at a time, so that large images need little extra memory."""


def write_png(path: str | os.PathLike[str], color: NDArray[Any], exposure: float = 0.0) -> None:
    """Write linear RGBA as an sRGB PNG.

    Parameters
    ----------
    path : path
    color : (H, W, 4) float array
        Linear RGB, straight alpha.
    exposure : float
        Stops: RGB is multiplied by 2^exposure.

    Raises
    ------
    FileError
        The file cannot be written; an existing file is unchanged.
    SettingsError
        `exposure` is not between -100 and 100.
    """
    data = encode_png(color, exposure)
    with atomic_path(path) as temporary:
        temporary.write_bytes(data)


def encode_png(color: NDArray[Any], exposure: float = 0.0) -> bytes:
    """Return the bytes of `write_png`'s file; equal pixels give equal bytes."""
    import imageio.v3 as iio

    return iio.imwrite("<bytes>", to_srgb8(color, exposure), extension=".png", plugin="pillow")


def to_srgb8(color: NDArray[Any], exposure: float = 0.0) -> NDArray[np.uint8]:
    """Encode linear RGBA with the sRGB curve (IEC 61966-2-1), clamped to [0, 1]; NaN becomes 0.

    Parameters
    ----------
    color : (H, W, 4) float array
        Linear RGB, straight alpha.
    exposure : float
        Stops: RGB is multiplied by 2^exposure before the curve.

    Returns
    -------
    (H, W, 4) uint8
        The nearest of 256 levels; alpha stays linear.
    """
    check_exposure(exposure)
    gain = 2.0**exposure
    encoded = np.empty(color.shape, np.uint8)
    for top in range(0, len(color), BAND):
        band = color[top : top + BAND].astype(np.float64)
        band[np.isnan(band)] = 0.0
        linear = np.clip(band[..., :3] * gain, 0.0, 1.0)
        curved = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
        encoded[top : top + BAND, :, :3] = np.rint(255 * curved)
        encoded[top : top + BAND, :, 3] = np.rint(255 * np.clip(band[..., 3], 0.0, 1.0))
    return encoded


def check_exposure(exposure: float) -> None:
    """Raise `SettingsError` if `exposure` is out of range, stops."""
    if not -MAX_EXPOSURE <= exposure <= MAX_EXPOSURE:
        raise SettingsError(f"exposure {exposure} must be between -{MAX_EXPOSURE:g} and {MAX_EXPOSURE:g} stops")
