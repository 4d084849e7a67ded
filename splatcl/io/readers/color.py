"""Conversion of a file's colors to linear RGB."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def srgb_to_linear(color: NDArray[Any]) -> NDArray[np.float32]:
    """Decode sRGB (IEC 61966-2-1) to linear RGB; values outside [0, 1] are clamped first."""
    c = np.clip(np.asarray(color, np.float64), 0.0, 1.0)
    return np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4).astype(np.float32)


def linear_color(color: NDArray[Any], notes: list[str]) -> NDArray[Any]:
    """Convert a file's colors to linear RGB.

    Parameters
    ----------
    color : (N, 3) array
        Integers are sRGB of 8 or 16 bits (`is_8bit`); floats are linear.
    notes : list of str
        Receives a sentence about floats too large for linear colors.

    Returns
    -------
    (N, 3) float32 or float64 array
        Linear RGB.
    """
    if color.dtype.kind == "f":
        if color.size and np.nanmax(color, initial=0.0) > 16.0:
            notes.append(
                f"took float colors up to {np.nanmax(color):.6g} as linear; store 8-bit colors as integer properties"
            )
        return color
    return linear_integers(color, 255 if is_8bit(color) else 65535)


def linear_integers(color: NDArray[Any], white: int) -> NDArray[np.float32]:
    """Convert sRGB integers from 0 to `white` to linear RGB; other values are clamped."""
    table = srgb_to_linear(np.arange(white + 1) / white)
    if color.dtype == np.min_scalar_type(white):  # no value needs clamping
        return table[color]
    return table.take(color, mode="clip")


def is_8bit(color: NDArray[Any]) -> bool:
    """Return whether 255 is white: the type has 8 bits, or has more than 16 and no value is above 255."""
    return color.dtype.itemsize == 1 or (color.dtype.itemsize > 2 and color.max(initial=0) <= 255)
