"""Splats on the device, relative to a near origin; uploaded once for many frames."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splatcl.opencl.device.program import file_of
from splatcl.opencl.device.strictness import Device
from splatcl.opencl.device.structs import REAL_CODES, structs
from splatcl.scene.settings import Precision
from splatcl.scene.splats import PREFIX, Splats

PHONG_ATTRIBUTES = ("specular", "shininess")
"""Splat attributes that replace the material's specular coefficient and shininess."""
GEOMETRY = ("center", "tangent_u", "tangent_v")
"""Arrays that are stored as planes too."""
EXTRA = {"normal_du", "normal_dv", "clip", *(PREFIX + name for name in PHONG_ATTRIBUTES)}
"""Names of the arrays in SplatExtra."""
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


def upload(
    device: Device,
    splats: Splats,
    precision: Precision,
    held: DeviceSplats | None = None,
    changed: frozenset[str] = frozenset(),
) -> DeviceSplats:
    """Copy splats to the device, relative to `near_origin`.

    Parameters
    ----------
    device : Device
    splats : Splats
    precision : {"single", "double"}
    held : DeviceSplats, optional
        An earlier upload of as many splats, whose buffers are written again; it must not be used afterwards.
    changed : frozenset of str
        Names of the arrays that differ from those of `held`, such as "center" or "attribute.NAME".
    """
    real, num = np.dtype(REAL_CODES[precision]), len(splats)
    stride = -(-max(num, 1) // PLANE_PAD) * PLANE_PAD
    if held is None:
        sizes = dict.fromkeys(GEOMETRY, 3 * stride) | {"splats": 12 * max(num, 1)}
        buffers = {name: device.buffer(size * real.itemsize) for name, size in sizes.items()}
        changed = frozenset({*GEOMETRY, "color", *splats.optional})
        held = DeviceSplats(
            **buffers, center_low=None, origin=near_origin(splats.center), num_splats=num, stride=stride
        )
    center = splats.center
    if "center" in changed:
        origin = near_origin(center)
        center = center - origin if origin.any() else center
        rest = center - center.astype(real)
        low = np.ascontiguousarray(rest, real) if rest.any() else None
        held = replace(held, origin=origin, center_low=_copied(device, held.center_low, low))
    _write_records(device, held, {"center": center, **_vectors(splats)}, precision, changed)
    options = {"CLIP": int(splats.clip is not None), "GLOSS": int(bool({*PHONG_ATTRIBUTES} & splats.attributes.keys()))}
    extra = held.extra
    if changed & EXTRA:
        needed = any(options.values()) or splats.normal_du is not None
        extra = _copied(device, extra, _extra(splats, real) if needed else None)
    groups = _attribute_groups(device, splats, real, held.attribute_groups, changed)
    return replace(held, extra=extra, options=options, attribute_groups=groups)


def _vectors(splats: Splats) -> dict[str, NDArray[Any]]:
    return {"tangent_u": splats.tangent_u, "tangent_v": splats.tangent_v, "color": splats.color}


def _write_records(
    device: Device,
    held: DeviceSplats,
    arrays: Mapping[str, NDArray[Any]],
    precision: Precision,
    changed: frozenset[str],
) -> None:
    """Write the changed ones of `arrays`, each (N, 3) and in the order of Splat's fields, to planes and records."""
    real, (dtypes, declarations) = np.dtype(REAL_CODES[precision]), structs(REAL_CODES[precision])
    program = device.program(file_of("upload_records"), declarations, LANES=1, DOUBLE=int(real == np.float64))
    num, stride, num_fields = map(np.int32, (held.num_splats, held.stride, dtypes["Splat"].itemsize // real.itemsize))
    for k, (name, values) in enumerate(arrays.items()):
        if name not in changed:
            continue
        given = device.upload(np.ascontiguousarray(values, real)) if num else held.splats
        program(device.queue, "upload_records", (int(num), 3), 1, given, num_fields, np.int32(3 * k), held.splats)
        if planes := getattr(held, name, None):
            program(device.queue, "upload_planes", (int(stride), 3), 1, given, num, stride, planes)


def _copied(device: Device, buffer: Any, array: NDArray[Any] | None) -> Any:
    """Return `buffer`, or a new one if there is none, with a copy of `array`; None if `array` is."""
    if array is None or buffer is None:
        return None if array is None else device.upload(array)
    device.write(buffer, array)
    return buffer


def _extra(splats: Splats, real: np.dtype[Any]) -> NDArray[Any]:
    """Return (N, 14), SplatExtra of each splat; NaN where the material's specular or shininess applies."""
    num = len(splats)
    columns = [np.zeros((num, 6)) if splats.clip is None else splats.clip.reshape(num, 6)]
    columns += [np.zeros((num, 3)) if f is None else f for f in (splats.normal_du, splats.normal_dv)]
    columns += [splats.attributes.get(name, np.full(num, np.nan))[:, None] for name in PHONG_ATTRIBUTES]
    return np.hstack(columns).astype(real) if num else np.zeros(14, real)


def _attribute_groups(
    device: Device, splats: Splats, real: np.dtype[Any], held: tuple[AttributeGroup, ...], changed: frozenset[str]
) -> tuple[AttributeGroup, ...]:
    """Return six attributes of every splat at a time, in the order of `channel_names`; write only what changed."""
    names, groups = channel_names(splats.attributes), []
    for first in range(0, len(names), 6):
        group = tuple(names[first : first + 6])
        buffer = next((g.values for g in held if g.names == group), None)
        if buffer is None or changed & {PREFIX + name for name in group}:
            values = np.zeros((max(len(splats), 1), 8), real)
            for k, name in enumerate(group):
                if name:
                    values[: len(splats), k] = splats.attributes[name]
            buffer = _copied(device, buffer, values)
        groups.append(AttributeGroup(group, buffer))
    return tuple(groups)


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
    # By columns: NumPy's min(axis=0) is 30 times slower.
    low, high = (np.array([of(column) for column in center.T], np.float64) for of in (np.min, np.max))
    middle = (low + high) / 2
    return np.where(np.abs(middle) > 4 * (high - low), middle.astype(np.float32).astype(np.float64), 0.0)
