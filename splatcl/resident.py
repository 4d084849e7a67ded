"""Splats on the device: planes of coordinates near an origin, uploaded once for many frames."""

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

ATTRIBUTE_PLANES = ("center", "tangent_u", "tangent_v", "color")
PLANE_PAD = 16
"""Planes are padded to the widest vector, so that the last one may be read whole."""


@dataclass(frozen=True)
class ResidentSplats:
    """Splats on the device, as planes relative to `origin` (world space, float64).

    `center_low` is what single precision leaves of float64 centres, None where that is nothing.
    """

    center: Any
    center_low: Any
    tangent_u: Any
    tangent_v: Any
    color: Any
    origin: NDArray[np.float64]
    num_splats: int
    stride: int


def upload(device: DeviceQueue, splats: Splats, precision: Precision) -> ResidentSplats:
    """Copy splats to the device as planes of x, y, z (or r, g, b), relative to an origin near them."""
    real = np.dtype(REAL[precision])
    origin = near_origin(splats.center)
    num = len(splats)
    stride = -(-max(num, 1) // PLANE_PAD) * PLANE_PAD
    arrays = {name: getattr(splats, name) for name in ATTRIBUTE_PLANES}
    if origin.any():
        arrays["center"] = arrays["center"] - origin
    rest = arrays["center"] - arrays["center"].astype(real)
    buffers: dict[str, Any] = {"center_low": None}
    for name, values in (arrays | {"center_low": rest} if rest.any() else arrays).items():
        planes = np.zeros((3, stride), real)
        planes[:, :num] = values.T
        buffers[name] = device.buffer(planes.nbytes)
        device.write(buffers[name], planes)
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
