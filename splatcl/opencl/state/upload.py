"""Splats on the device, relative to a near origin; uploaded once for many frames."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splatcl.opencl.device.strictness import Device
from splatcl.opencl.device.structs import REAL_CODES
from splatcl.scene.settings import Precision
from splatcl.scene.splats import Splats

PHONG_ATTRIBUTES = ("specular", "shininess")
"""Splat attributes that replace the material's specular coefficient and shininess."""
PLANE_PAD = 16
"""Reals that a plane's length is a multiple of: the widest vector, so kernels can read the last vector whole."""


@dataclass(frozen=True)
class DeviceSplats:
    """Splats on the device, in world space relative to `origin`.

    The geometry is stored twice. Binning streams the planes of x, y and z. The projection fetches `splats` in the
    order of the tile lists.
    """

    center: Any  # (3, stride) real, scene units
    tangent_u: Any  # (3, stride) real, scene units
    tangent_v: Any  # (3, stride) real, scene units
    splats: Any  # (N,) Splat: center, tangents, linear RGB
    center_low: Any  # (N, 3) real, the rest of float64 centers after rounding to `real`; None if all are 0
    origin: NDArray[np.float64]  # (3,) world space
    num_splats: int
    stride: int  # N rounded up to a multiple of PLANE_PAD
    extra: Any = None  # (N,) SplatExtra; None if no splat has any of it
    options: Mapping[str, int] = field(default_factory=lambda: {"CLIP": 0, "GLOSS": 0})  # kernels/splat/extra.h
    attribute_groups: tuple[AttributeGroup, ...] = ()


@dataclass(frozen=True)
class AttributeGroup:
    """Up to six attributes of every splat: two images of three channels."""

    names: tuple[str, ...]  # of each column; "" for an unused one
    values: Any  # (N, 8) real, six columns used


def upload(device: Device, splats: Splats, precision: Precision) -> DeviceSplats:
    """Copy splats to the device, relative to `near_origin`."""
    real = np.dtype(REAL_CODES[precision])
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
    options = {"CLIP": int(splats.clip is not None), "GLOSS": int(bool({*PHONG_ATTRIBUTES} & splats.attributes.keys()))}
    if any(options.values()) or splats.normal_du is not None:
        buffers["extra"] = device.upload(_extra(splats, real))
    groups = tuple(AttributeGroup(names, device.upload(values)) for names, values in _attribute_groups(splats, real))
    return DeviceSplats(
        **buffers, origin=origin, num_splats=num, stride=stride, options=options, attribute_groups=groups
    )


def _extra(splats: Splats, real: np.dtype[Any]) -> NDArray[Any]:
    """Return (N, 14), SplatExtra of each splat; NaN where the material's specular or shininess applies."""
    num = len(splats)
    columns = [np.zeros((num, 6)) if splats.clip is None else splats.clip.reshape(num, 6)]
    columns += [np.zeros((num, 3)) if f is None else f for f in (splats.normal_du, splats.normal_dv)]
    columns += [splats.attributes.get(name, np.full(num, np.nan))[:, None] for name in PHONG_ATTRIBUTES]
    return np.hstack(columns).astype(real) if num else np.zeros(14, real)


def _attribute_groups(splats: Splats, real: np.dtype[Any]) -> Iterator[tuple[tuple[str, ...], NDArray[Any]]]:
    """Yield the names and (N, 8) values of six attributes at a time, in the order of `channel_names`."""
    names = channel_names(splats.attributes)
    for first in range(0, len(names), 6):
        group = tuple(names[first : first + 6])
        values = np.zeros((max(len(splats), 1), 8), real)
        for k, name in enumerate(group):
            if name:
                values[: len(splats), k] = splats.attributes[name]
        yield group, values


def channel_names(attributes: Mapping[str, Any]) -> list[str]:
    """Return the attributes' names in the order of the channels.

    Specular and shininess come first, where kernels/passes/shade.cl reads them; if only one exists, "" stands for the
    other.
    """
    names = [name for name in attributes if name not in PHONG_ATTRIBUTES]
    has_any = bool({*PHONG_ATTRIBUTES} & attributes.keys())
    return [*(name if name in attributes else "" for name in PHONG_ATTRIBUTES if has_any), *names]


def near_origin(center: NDArray[Any]) -> NDArray[np.float64]:
    """Return the (3,) origin to subtract in float64; 0 on an axis where float32 is precise enough without it.

    The origin is a float32 number, so float32 centers lose no bit by the subtraction.
    """
    if not len(center):
        return np.zeros(3)
    low, high = center.min(axis=0).astype(np.float64), center.max(axis=0).astype(np.float64)
    middle = (low + high) / 2
    return np.where(np.abs(middle) > 4 * (high - low), middle.astype(np.float32).astype(np.float64), 0.0)
