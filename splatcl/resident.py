"""Splats on the device, near an origin, uploaded once for many frames."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from splatcl.layout import REAL
from splatcl.settings import Precision
from splatcl.splats import Splats

if TYPE_CHECKING:
    from splatcl.device import DeviceQueue

PLANE_PAD = 16
"""Planes are padded to the widest vector, so that the last one may be read whole."""


@dataclass(frozen=True)
class ResidentSplats:
    """Splats on the device, relative to `origin` (world space, float64).

    The geometry lies twice: as planes of x, y, z, which binning streams, and splat by splat with the colour
    (layout.py, Splat), which the projection fetches in the order of the tile lists. `center_low` is what single
    precision leaves of float64 centres, splat by splat, None where that is nothing.
    """

    center: Any
    tangent_u: Any
    tangent_v: Any
    splats: Any
    center_low: Any
    origin: NDArray[np.float64]
    num_splats: int
    stride: int


def upload(device: DeviceQueue, splats: Splats, precision: Precision) -> ResidentSplats:
    """Copy splats to the device, relative to an origin near them."""
    real = np.dtype(REAL[precision])
    origin = near_origin(splats.center)
    num = len(splats)
    stride = -(-max(num, 1) // PLANE_PAD) * PLANE_PAD
    center = splats.center - origin if origin.any() else splats.center
    geometry = {"center": center, "tangent_u": splats.tangent_u, "tangent_v": splats.tangent_v}
    buffers: dict[str, Any] = {"center_low": None}
    for name, values in geometry.items():
        planes = np.zeros((3, stride), real)
        planes[:, :num] = values.T
        buffers[name] = device.upload(planes)
    together = [np.asarray(values, real) for values in (*geometry.values(), splats.color)]
    buffers["splats"] = device.upload(np.hstack(together) if num else np.zeros(12, real))
    rest = center - center.astype(real)
    if rest.any():
        buffers["center_low"] = device.upload(np.ascontiguousarray(rest, real))
    return ResidentSplats(**buffers, origin=origin, num_splats=num, stride=stride)


def near_origin(center: NDArray[Any]) -> NDArray[np.float64]:
    """Return (3,) the origin to subtract in double: 0 on an axis where float32 loses nothing much without it.

    It is a float32 number, so that float32 centres lose no bit by the subtraction.
    """
    if not len(center):
        return np.zeros(3)
    low, high = center.min(axis=0).astype(np.float64), center.max(axis=0).astype(np.float64)
    middle = (low + high) / 2
    return np.where(np.abs(middle) > 4 * (high - low), middle.astype(np.float32).astype(np.float64), 0.0)
