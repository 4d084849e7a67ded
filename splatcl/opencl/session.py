"""Session: one OpenCL device, opened once, and the splats uploaded to it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from splatcl.errors import DeviceError, InvalidSplatsError, SettingsError
from splatcl.opencl.device.devices import forked
from splatcl.opencl.device.queue import WorkItem
from splatcl.opencl.device.strictness import Device
from splatcl.opencl.device.worker import worker
from splatcl.opencl.state.context import PassContext
from splatcl.opencl.state.upload import DeviceSplats, upload
from splatcl.scene.camera import Camera
from splatcl.scene.settings import RenderSettings
from splatcl.scene.splats import PREFIX, Splats, float_array

TILE_SIZES = (8, 16, 32, 64)
Result = TypeVar("Result")
Copies = dict[tuple[Device, str], tuple[DeviceSplats, frozenset[str]]]
"""Uploads by device and precision, each with the names of its outdated arrays."""


@dataclass(frozen=True)
class UploadedSplats:
    """Splats for many frames with one upload to each device (`Session.upload`).

    The object keeps the splats on the host, and a copy of them on every device that has drawn them.
    """

    splats: Splats
    auto_epsilon: float  # depth tolerance that "auto" stands for, scene units
    _on_device: dict[tuple[Device, str], Any] = field(default_factory=dict, repr=False)
    _prepared: dict[tuple[bool, bool], UploadedSplats] = field(default_factory=dict, repr=False)
    _outdated: Copies = field(default_factory=dict, repr=False)  # taken over from an earlier object, to write again
    _outdated_prepared: dict[tuple[bool, bool], Copies] = field(default_factory=dict, repr=False)

    def epsilon(self, settings: RenderSettings) -> float:
        """Return the depth tolerance that `settings` ask for, scene units."""
        return self.auto_epsilon if settings.epsilon == "auto" else settings.epsilon

    @cached_property
    def sphere(self) -> tuple[NDArray[np.float64], float]:
        """Center (3,), world space, and radius of the splats' bounding sphere, scene units; shadow maps enclose it."""
        return self.splats.bounding_sphere

    def prepared(self, settings: RenderSettings) -> UploadedSplats:
        """Return the splats after `half_inputs` and `circular` of the settings; keep them for the next frame.

        Raises
        ------
        SettingsError
            The settings need a normal field, which the splats lack.
        """
        if settings.normals == "field" and self.splats.normal_du is None:
            raise SettingsError(
                "normals='field' needs splats with a normal field; splatcl fields IN -o OUT estimates one, "
                "splatcl decimate --fields fits one to fewer splats"
            )
        key = (settings.half_inputs, bool(settings.circular))
        if key not in self._prepared:
            splats = self.splats.half_precision() if settings.half_inputs else self.splats
            splats = splats.circular() if settings.circular else splats
            outdated = self._outdated_prepared.pop(key, {})
            changed = UploadedSplats(splats, self.auto_epsilon, _outdated=outdated)
            self._prepared[key] = self if splats is self.splats else changed
        return self._prepared[key]

    def outdated(self, device: Device, layout: str) -> tuple[DeviceSplats | None, frozenset[str]]:
        """Hand over an earlier upload to `device`, to write again, and the names of the arrays that changed since."""
        return self._outdated.pop((device, layout), (None, frozenset()))

    def updated(self, splats: Splats, changed: frozenset[str]) -> UploadedSplats:
        """Return `splats` with the device buffers of this object, which gives them away (`Session.update`).

        `changed` are the names of the arrays in which `splats` differ.
        """
        turned = changed & {"tangent_u", "tangent_v"}
        epsilon = _median_radius(splats) if turned else self.auto_epsilon
        both = changed | {"tangent_u", "tangent_v"} if turned else changed  # `prepared` makes each from both
        given = {key: _touched(copies, both) for key, copies in self._outdated_prepared.items()}
        given |= {key: other._release(both) for key, other in self._prepared.items() if other is not self}
        return UploadedSplats(splats, epsilon, _outdated=self._release(changed), _outdated_prepared=given)

    def _release(self, changed: frozenset[str]) -> Copies:
        """Give away the copies that the passes read, of which the arrays `changed` are outdated."""
        held = [key for key, copy in self._on_device.items() if isinstance(copy, DeviceSplats)]
        copies = _touched(self._outdated, changed) | {key: (self._on_device.pop(key), changed) for key in held}
        self._outdated.clear()
        return copies

    def on(self, device: Device, layout: str, upload: Callable[[], Any]) -> Any:
        """Return the splats on `device` in the form named `layout`; call `upload` to make them once."""
        if (device, layout) not in self._on_device:
            self._on_device[device, layout] = upload()
        return self._on_device[device, layout]

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_on_device": {}, "_prepared": {}, "_outdated": {}, "_outdated_prepared": {}}


def _median_radius(splats: Splats) -> float:
    return float(np.median(splats.radius)) if len(splats) else 0.0


def _touched(copies: Copies, changed: frozenset[str]) -> Copies:
    return {key: (held, before | changed) for key, (held, before) in copies.items()}


class Session:
    """One OpenCL device, opened once, with its tile size, lanes and mapping; see `splatcl.Renderer`."""

    def __init__(
        self,
        device: str | int | None = None,
        tile_size: int = 16,
        lanes: int | None = None,
        mapping: WorkItem | None = None,
        allow_inexact: bool = False,
    ) -> None:
        if tile_size not in TILE_SIZES:
            raise SettingsError(f"tile_size {tile_size} is not one of {TILE_SIZES}")
        if lanes not in (None, 1, 4, 8, 16):
            raise SettingsError(f"lanes {lanes} is not one of 1, 4, 8, 16")
        if mapping not in (None, "tile", "pixel"):
            raise SettingsError(f"mapping {mapping!r} is not one of tile, pixel")
        if mapping == "pixel" and lanes not in (None, 1):
            raise SettingsError(f"mapping='pixel' needs lanes=1, not {lanes}")
        self._arguments = (device, tile_size, lanes, mapping, allow_inexact)
        self._device = None if forked() else Device(device, lanes, mapping, allow_inexact)
        if self._device is not None:
            self._device.strictness.options("single")  # refuse the device now rather than at the first frame

    @property
    def supports_double(self) -> bool:
        """True if the device has double precision; a forked process cannot query the device and assumes so."""
        return self._device is None or self._device.info.supports["double"] == "yes"

    def upload(self, splats: Splats) -> UploadedSplats:
        """Return `splats` for many frames with one upload."""
        return UploadedSplats(splats, _median_radius(splats))

    def update(
        self,
        uploaded: UploadedSplats,
        *,
        center: ArrayLike | None = None,
        tangent_u: ArrayLike | None = None,
        tangent_v: ArrayLike | None = None,
        color: ArrayLike | None = None,
        normal_du: ArrayLike | None = None,
        normal_dv: ArrayLike | None = None,
        clip: ArrayLike | None = None,
        attributes: Mapping[str, ArrayLike] | None = None,
    ) -> UploadedSplats:
        """Return uploaded splats with some arrays replaced, for models that move.

        The next frame copies only these arrays to the device, into the buffers of `uploaded`. Its bits are those of a
        fresh upload. Frames that were drawn before keep their AOVs. `uploaded` stays valid, but a further frame of it
        uploads all its arrays again.

        Parameters
        ----------
        uploaded : UploadedSplats
            What `upload` or `update` returned.
        center, tangent_u, tangent_v, color, normal_du, normal_dv, clip : array, optional
            As for `Splats`; arrays that are not given stay.
        attributes : mapping of str to (N,) float array, optional
            Attributes to replace or add; the others stay.

        Raises
        ------
        InvalidSplatsError
            An array has another number of splats than `uploaded`, or makes a splat invalid.
        """
        given = {
            "center": center, "tangent_u": tangent_u, "tangent_v": tangent_v, "color": color,
            "normal_du": normal_du, "normal_dv": normal_dv, "clip": clip,
        }  # fmt: skip
        arrays: dict[str, Any] = {name: values for name, values in given.items() if values is not None}
        named: dict[str, Any] = {} if attributes is None else dict(attributes)
        splats, changed = uploaded.splats, {*arrays, *(PREFIX + name for name in named)}
        if not changed:
            return uploaded
        for name, values in (arrays | named).items():
            if (num := len(np.atleast_1d(float_array(name, values)))) != len(splats):
                raise InvalidSplatsError(f"cannot update {len(splats)} splats: {name} has {num} rows; upload them anew")
        new = replace(splats, **arrays, attributes={**splats.attributes, **named}, on_invalid="drop")
        if len(new) < len(splats):
            raise InvalidSplatsError(f"cannot update: {new.notes[-1].removeprefix('dropped ')}; correct the arrays")
        return uploaded.updated(new, frozenset(changed))

    def as_uploaded(self, splats: Splats | UploadedSplats) -> UploadedSplats:
        """Return `splats` if they are uploaded already; else upload them for one frame."""
        return splats if isinstance(splats, UploadedSplats) else self.upload(splats)

    def call(self, function: Callable[..., Result], *args: Any) -> Result:
        """Return ``function(session, *args)``. A forked process runs it in its worker."""
        if self._device is None or forked():
            return worker().call(Session, self._arguments, function, *args)
        with self._device.lock:
            return function(self, *args)

    @property
    def device(self) -> Device:
        """The device that all kernels run on. For functions given to `call`."""
        assert self._device
        return self._device

    def pass_inputs(
        self, uploaded: UploadedSplats, camera: Camera, settings: RenderSettings, first: tuple[int, int] = (0, 0)
    ) -> tuple[PassContext, DeviceSplats]:
        """Return the inputs of one frame's passes: context and splats on the device. For functions given to `call`.

        `first` is the column and row of a window's first pixel (`PassContext`).
        """
        context, device, precision = self.context(camera, settings, first), self.device, settings.precision
        return context, uploaded.on(
            device, precision, lambda: upload(device, uploaded.splats, precision, *uploaded.outdated(device, precision))
        )

    def context(self, camera: Camera, settings: RenderSettings, first: tuple[int, int] = (0, 0)) -> PassContext:
        """Return the context of one frame's passes. For functions given to `call`; `first` as for `pass_inputs`."""
        if settings.precision == "double" and not self.supports_double:
            raise DeviceError(f"{self.device.info.name} has no double precision; choose another device")
        return PassContext(self.device, camera, settings, self._arguments[1], settings.precision, first)


@cache
def default_session(device: str | int | None = None) -> Session:
    """Return this process's session on `device`, opened once."""
    return Session(device)
