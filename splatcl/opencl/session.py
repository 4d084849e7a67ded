"""render(): splats and a camera in, a Frame out; Renderer keeps the device and its buffers between frames."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache, cached_property
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from splatcl.opencl.passes import bin as pipeline
from splatcl.opencl.aovs import DeviceAovs
from splatcl.scene.camera import Camera
from splatcl.opencl.device.devices import forked
from splatcl.opencl.device.queue import DeviceQueue, WorkItem
from splatcl.errors import DeviceError, SettingsError
from splatcl.frame import Frame
from splatcl.opencl.state.buffers import Shadows
from splatcl.opencl.state.context import PassContext
from splatcl.opencl.state.upload import DeviceSplats, upload
from splatcl.scene.settings import RenderSettings
from splatcl.opencl.passes.shadow import cast
from splatcl.scene.splats import Splats
from splatcl.opencl.supersampling import NEIGHBOURS, supersampled
from splatcl.opencl.device.worker import worker

TILE_SIZES = (8, 16, 32, 64)
Result = TypeVar("Result")


@dataclass(frozen=True)
class Resident:
    """Splats that were uploaded once for many frames (`Renderer.upload`)."""

    splats: Splats
    auto_epsilon: float
    _on_device: dict[tuple[DeviceQueue, str], Any] = field(default_factory=dict, repr=False)
    _prepared: dict[tuple[bool, bool], Resident] = field(default_factory=dict, repr=False)

    def epsilon(self, settings: RenderSettings) -> float:
        """Return the depth tolerance, scene units."""
        return self.auto_epsilon if settings.epsilon == "auto" else settings.epsilon

    @cached_property
    def sphere(self) -> tuple[NDArray[np.float64], float]:
        """The splats' bounding sphere, around which shadow maps are drawn."""
        return self.splats.bounding_sphere

    def prepared(self, settings: RenderSettings) -> Resident:
        """Return the splats as the settings take them, and keep them; `SettingsError` where they cannot."""
        if settings.normals == "field" and self.splats.normal_du is None:
            raise SettingsError(
                "normals='field' needs splats with a normal field: splatcl fields IN -o OUT estimates one, "
                "splatcl decimate --fields fits one to fewer splats"
            )
        key = (settings.half_inputs, bool(settings.circular))
        if key not in self._prepared:
            splats = self.splats.half_precision() if settings.half_inputs else self.splats
            splats = splats.circular() if settings.circular else splats
            self._prepared[key] = self if splats is self.splats else Resident(splats, self.auto_epsilon)
        return self._prepared[key]

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_on_device": {}, "_prepared": {}}


class Renderer:
    """Renders frames on one OpenCL device, which it opens once.

    Parameters
    ----------
    device : str or int, optional
        An index of `splatcl devices` or words of a platform's, version's or device's name; SPLATCL_DEVICE and
        then PoCL's CPU by default.
    tile_size : {8, 16, 32, 64}
        Pixels; changes speed only, never a bit of the image.
    lanes : {1, 4, 8, 16}, optional
        Vector width in single precision, 8 on a CPU and 1 elsewhere by default; changes speed only. PoCL 3.0 has
        no 16.
    mapping : {"tile", "pixel"}, optional
        Whether a work-item of the raster passes takes a tile (the default on a CPU) or a pixel (elsewhere, and
        then ``lanes`` is 1); changes speed only.
    allow_inexact : bool
        Render even if the device's arithmetic is not strict or the environment injects compiler flags; the frame's
        metadata then says why the image is "inexact".

    Raises
    ------
    DeviceError
        No such device, it does not start, or it may not render references (`splatcl doctor`).
    SettingsError
        A tile size, a number of lanes or a mapping that the kernels do not have.
    """

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
            raise SettingsError(f"lanes {lanes} is not 1, 4, 8 or 16")
        if mapping not in (None, "tile", "pixel"):
            raise SettingsError(f"mapping {mapping!r} is neither 'tile' nor 'pixel'")
        if mapping == "pixel" and lanes not in (None, 1):
            raise SettingsError(f"mapping='pixel' needs lanes=1, not {lanes}")
        self._arguments = (device, tile_size, lanes, mapping, allow_inexact)
        self._device = None if forked() else DeviceQueue(device, lanes, mapping, allow_inexact)
        if self._device is not None:
            self._device.strictness.options("single")  # refuse the device now rather than at the first frame

    @property
    def supports_double(self) -> bool:
        """Whether the device has double precision; a forked process does not know and says that it has."""
        return self._device is None or self._device.info.supports["double"] == "yes"

    def upload(self, splats: Splats) -> Resident:
        """Return `splats` for many renders with one upload."""
        return Resident(splats, float(np.median(splats.radius)) if len(splats) else 0.0)

    def render(self, splats: Splats | Resident, camera: Camera, settings: RenderSettings | None = None) -> Frame:
        """Render one frame; see `render`."""
        settings = RenderSettings() if settings is None else settings
        resident = self.resident(splats).prepared(settings)
        settings = pipeline.effective_settings(settings, resident.splats.oriented)
        frame = self.call(_render, resident, camera, settings)
        frame.rendered_from = (self, resident)
        return frame

    def resident(self, splats: Splats | Resident) -> Resident:
        """Return `splats` as they are, or for one render only."""
        return splats if isinstance(splats, Resident) else self.upload(splats)

    def call(self, function: Callable[..., Result], *args: Any) -> Result:
        """Return ``function(renderer, *args)``, run here, or in the worker of a process that was forked."""
        if self._device is None or forked():
            return worker().call(self._arguments, function, *args)
        with self._device.lock:
            return function(self, *args)

    @property
    def device(self) -> DeviceQueue:
        """The queue that everything runs on. For functions given to `call`."""
        assert self._device
        return self._device

    def prepare(
        self, resident: Resident, camera: Camera, settings: RenderSettings, first: tuple[int, int] = (0, 0)
    ) -> tuple[PassContext, DeviceSplats]:
        """Return what every pass of one frame needs, and the splats on the device. For functions given to `call`.

        `first` is the column and row of a window's first pixel (`PassContext`).
        """
        passes, device = self.passes(camera, settings, first), self.device
        key = (device, settings.precision)
        if key not in resident._on_device:
            resident._on_device[key] = upload(device, resident.splats, settings.precision)
        return passes, resident._on_device[key]

    def passes(self, camera: Camera, settings: RenderSettings, first: tuple[int, int] = (0, 0)) -> PassContext:
        """Return what every pass of one frame needs. For functions given to `call`; `first` as for `prepare`."""
        if settings.precision == "double" and not self.supports_double:
            raise DeviceError(f"{self.device.info.name} has no double precision; choose another device")
        return PassContext(self.device, camera, settings, self._arguments[1], settings.precision, first)


def _render(renderer: Renderer, resident: Resident, camera: Camera, settings: RenderSettings) -> Frame:
    shadows = cast(renderer, resident, camera, settings, resident.epsilon(settings))

    def window(camera: Camera, first: tuple[int, int] = (0, 0)) -> DeviceAovs:
        return _draw(renderer, resident, camera, settings, first, shadows)

    n = settings.supersampling
    aovs = window(camera) if n == 1 else supersampled(camera, n, window, NEIGHBOURS.get(settings.shader, 0))
    metadata = {
        "epsilon": resident.epsilon(settings),
        "num_splats": len(resident.splats),
        "num_dropped": resident.splats.num_dropped,
        "notes": list(resident.splats.notes),
        "device": f"{renderer.device.info.version}, {renderer.device.info.name}",
    }
    if shadows:
        metadata["shadow_bias"] = shadows.bias
    if inexact := renderer.device.strictness.reason(settings.precision):
        metadata["inexact"] = inexact
    return Frame(aovs, camera, settings, metadata)


def _draw(
    renderer: Renderer,
    resident: Resident,
    camera: Camera,
    settings: RenderSettings,
    first: tuple[int, int],
    shadows: Shadows | None = None,
) -> DeviceAovs:
    """Run the passes for the window of a larger image that begins at `first` (`PassContext`)."""
    passes, on_device = renderer.prepare(resident, camera, settings, first)
    epsilon = resident.epsilon(settings)
    view = passes.view(on_device.origin)
    depth, gbuffer = pipeline.frame_buffers(passes)
    channels = [(passes.image(3), passes.image(3)) for _ in on_device.channels]
    for lists in pipeline.bin(passes, view, on_device):
        projected = pipeline.project_and_see(passes, view, on_device, lists, depth, epsilon)
        pipeline.attributes(passes, view, lists, projected, depth, epsilon, gbuffer)
        for group, images in zip(on_device.channels, channels, strict=True):
            pipeline.channels(passes, view, lists, projected, depth, epsilon, group.values, images)
    names = {
        name: (images[k // 3], k % 3)
        for g, images in zip(on_device.channels, channels, strict=True)
        for k, name in enumerate(g.names)
        if name
    }
    color = pipeline.shade(passes, view, depth, gbuffer, epsilon, names, shadows)
    return DeviceAovs(passes, view, depth, gbuffer, color, names)


@cache
def default_renderer(device: str | int | None = None) -> Renderer:
    """Return this process's renderer for `device`, opened once."""
    return Renderer(device)


def render(
    splats: Splats, camera: Camera, settings: RenderSettings | None = None, *, device: str | int | None = None
) -> Frame:
    """Render splats: bin, project, visibility, attributes, shade ([BHZK05] figure 1).

    Parameters
    ----------
    splats : Splats
    camera : Camera
    settings : RenderSettings, optional
        The paper's defaults where omitted.
    device : str or int, optional
        As for `Renderer`.

    Returns
    -------
    Frame
        `frame.color` (H, W, 4) float32 linear RGBA and every AOV by name.

    Raises
    ------
    SettingsError
        The settings have no meaning for these splats.
    DeviceError
        No usable device, or the image is too large for it.
    """
    return default_renderer(device).render(splats, camera, settings)
