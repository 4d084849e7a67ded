"""Colors as files store them, to linear RGB."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def srgb_to_linear(color: NDArray[Any]) -> NDArray[np.float32]:
    """Undo the sRGB transfer function (IEC 61966-2-1); values outside [0, 1] are clamped first."""
    c = np.clip(np.asarray(color, np.float64), 0.0, 1.0)
    return np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4).astype(np.float32)


def linear_color(color: NDArray[Any], note: list[str]) -> NDArray[Any]:
    """Return linear RGB for color as a file stores it.

    Parameters
    ----------
    color : (N, 3) array
        Integers are sRGB, of 8 bits if their type is or no value is above 255 in a type wider than 16, else of
        16 bits. Floats are linear already.
    note : list of str
        Gets a sentence where the values do not look like what they are taken for.

    Returns
    -------
    (N, 3) float32 or float64 array
        Linear RGB.
    """
    if color.dtype.kind == "f":
        if color.size and np.nanmax(color, initial=0.0) > 16.0:
            note.append(
                f"float colors reach {np.nanmax(color):.6g} and were taken as linear; 8-bit colors "
                "belong in integer properties"
            )
        return color
    return linear_integers(color, 255 if is_8bit(color) else 65535)


def linear_integers(color: NDArray[Any], white: int) -> NDArray[np.float32]:
    """Return linear RGB for sRGB integers, from a table of all levels up to `white`; others are clamped."""
    table = srgb_to_linear(np.arange(white + 1) / white)
    if color.dtype == np.min_scalar_type(white):  # needs no clamping
        return table[color]
    return table.take(color, mode="clip")


def is_8bit(color: NDArray[Any]) -> bool:
    """Return whether integer colors have 255 as their white."""
    return color.dtype.itemsize == 1 or (color.dtype.itemsize > 2 and color.max(initial=0) <= 255)
