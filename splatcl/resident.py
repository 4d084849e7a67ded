"""Splats on the device, near an origin, uploaded once for many frames."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from splatcl.layout import REAL
from splatcl.settings import Precision
from splatcl.splats import Splats

if TYPE_CHECKING:
    from splatcl.device import DeviceQueue

GLOSS = ("specular", "shininess")
"""Attributes that take the place of the material's."""
PLANE_PAD = 16
"""Planes are padded to the widest vector, so that the last one may be read whole."""


@dataclass(frozen=True)
class ResidentSplats:
    """Splats on the device, relative to `origin` (world space, float64).

    The geometry lies twice: as planes of x, y, z, which binning streams, and splat by splat with the colour
    (layout.py, Splat), which the projection fetches in the order of the tile lists. `center_low` is what single
    precision leaves of float64 centres, splat by splat, None where that is nothing. `extra` holds what only some splats
    have (layout.py, SplatExtra), None where none has it; `options` says what (kernels/splat/extra.h).
    """

    center: Any
    tangent_u: Any
    tangent_v: Any
    splats: Any
    center_low: Any
    origin: NDArray[np.float64]
    num_splats: int
    stride: int
    extra: Any = None
    options: Mapping[str, int] = field(default_factory=lambda: {"CLIP": 0, "GLOSS": 0})
    channels: tuple[Channels, ...] = ()


@dataclass(frozen=True)
class Channels:
    """Up to six attributes of every splat; a name is empty where there is none of it."""

    names: tuple[str, ...]
    values: Any


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
    options = {"CLIP": int(splats.clip is not None), "GLOSS": int(bool({*GLOSS} & splats.attributes.keys()))}
    if any(options.values()) or splats.normal_du is not None:
        buffers["extra"] = device.upload(_extra(splats, real))
    channels = tuple(Channels(names, device.upload(values)) for names, values in _channels(splats, real))
    return ResidentSplats(**buffers, origin=origin, num_splats=num, stride=stride, options=options, channels=channels)


def _extra(splats: Splats, real: np.dtype[Any]) -> NDArray[Any]:
    """Return a row of SplatExtra for each splat; what the material has stands in the columns of its gloss as NaN."""
    num = len(splats)
    columns = [np.zeros((num, 6)) if splats.clip is None else splats.clip.reshape(num, 6)]
    columns += [np.zeros((num, 3)) if f is None else f for f in (splats.normal_du, splats.normal_dv)]
    columns += [splats.attributes.get(name, np.full(num, np.nan))[:, None] for name in GLOSS]
    return np.hstack(columns).astype(real) if num else np.zeros(14, real)


def _channels(splats: Splats, real: np.dtype[Any]) -> Iterator[tuple[tuple[str, ...], NDArray[Any]]]:
    """Yield the attributes six by six, in rows of eight; specular and shininess are first (kernels/passes/shade.cl)."""
    names = channel_names(splats.attributes)
    for first in range(0, len(names), 6):
        group = tuple(names[first : first + 6])
        values = np.zeros((max(len(splats), 1), 8), real)
        for k, name in enumerate(group):
            if name:
                values[: len(splats), k] = splats.attributes[name]
        yield group, values


def channel_names(attributes: Mapping[str, Any]) -> list[str]:
    """Return attributes' names in the order of the channels: any gloss first, as two, "" for one that is not there."""
    names = [name for name in attributes if name not in GLOSS]
    has_gloss = bool({*GLOSS} & attributes.keys())
    return [*(name if name in attributes else "" for name in GLOSS if has_gloss), *names]


def near_origin(center: NDArray[Any]) -> NDArray[np.float64]:
    """Return (3,) the origin to subtract in double: 0 on an axis where float32 loses nothing much without it.

    It is a float32 number, so that float32 centres lose no bit by the subtraction.
    """
    if not len(center):
        return np.zeros(3)
    low, high = center.min(axis=0).astype(np.float64), center.max(axis=0).astype(np.float64)
    middle = (low + high) / 2
    return np.where(np.abs(middle) > 4 * (high - low), middle.astype(np.float32).astype(np.float64), 0.0)
