"""All passes of a frame, in order ([BHZK05] figure 1): read this first.

bin lists the splats of each tile, project makes their records, visibility finds depth(p), attributes sums the
fragments within epsilon of it, and shade lights each pixel once. kernels/passes has a kernel of each name.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

from splatcl.opencl.aovs import DeviceAovs
from splatcl.opencl.passes.attributes import attributes, channels
from splatcl.opencl.passes.bin import bin
from splatcl.opencl.passes.shade import shade
from splatcl.opencl.passes.shadow import cast
from splatcl.opencl.passes.visibility import project_and_see
from splatcl.opencl.session import Session, UploadedSplats
from splatcl.opencl.state.buffers import Band, Shadows
from splatcl.opencl.state.context import PassContext, frame_buffers
from splatcl.opencl.state.lights import light_options
from splatcl.opencl.state.upload import DeviceSplats
from splatcl.opencl.supersampling import NEIGHBORS, supersampled
from splatcl.scene.camera import Camera
from splatcl.scene.settings import RenderSettings, effective_settings
from splatcl.scene.splats import Splats


@dataclass(frozen=True)
class Drawn:
    """The AOVs of a frame, how they were made, and the splats that they show."""

    aovs: Mapping[str, NDArray[Any]]
    settings: RenderSettings
    metadata: dict[str, Any]
    uploaded: UploadedSplats


def draw(session: Session, splats: Splats | UploadedSplats, camera: Camera, settings: RenderSettings) -> Drawn:
    """Draw one frame.

    Parameters
    ----------
    session : Session
    splats : Splats or UploadedSplats
    camera : Camera
    settings : RenderSettings

    Returns
    -------
    Drawn
        AOVs stay on the device until they are first read. The metadata holds the epsilon used, the device and the
        splats' notes.

    Raises
    ------
    SettingsError
        The settings have no meaning for these splats.
    DeviceError
        The image is too large for the device, or it lacks the precision.
    """
    uploaded = session.uploaded(splats).prepared(settings)
    settings = effective_settings(settings, uploaded.splats.oriented)
    aovs, metadata = session.call(_draw, uploaded, camera, settings)
    return Drawn(aovs, settings, metadata, uploaded)


def _draw(
    session: Session, uploaded: UploadedSplats, camera: Camera, settings: RenderSettings
) -> tuple[Mapping[str, NDArray[Any]], dict[str, Any]]:
    """Draw the image, in one piece or window by window; return its AOVs and metadata. For `Session.call`."""
    epsilon, splats, shadows = uploaded.epsilon(settings), uploaded.splats, None
    if "SHADOWS" in light_options(settings):
        shadows = cast(*session.prepare(uploaded, camera, settings), uploaded.sphere, epsilon)

    def window(camera: Camera, first: tuple[int, int] = (0, 0)) -> DeviceAovs:
        return _draw_window(*session.prepare(uploaded, camera, settings, first), epsilon, shadows)

    n = settings.supersampling
    aovs = window(camera) if n == 1 else supersampled(camera, n, window, NEIGHBORS.get(settings.shader, 0))
    metadata = {
        "epsilon": epsilon,
        "num_splats": len(splats),
        "num_dropped": splats.num_dropped,
        "notes": list(splats.notes),
        "device": f"{session.device.info.version}, {session.device.info.name}",
    }
    if shadows:
        metadata["shadow_bias"] = shadows.bias
    if inexact := session.device.strictness.reason(settings.precision):
        metadata["inexact"] = inexact
    return aovs, metadata


def _draw_window(
    context: PassContext, splats: DeviceSplats, epsilon: float, shadows: Shadows | None = None
) -> DeviceAovs:
    """Run every pass for the context's window."""
    view = context.view(splats.origin)
    depth, gbuffer = frame_buffers(context)
    images = [(context.image(3), context.image(3)) for _ in splats.channels]
    for lists in bin(context, view, splats):
        projected = project_and_see(context, view, splats, lists, depth, epsilon)
        band = Band(view, lists, projected, depth, epsilon)
        attributes(context, band, gbuffer)
        for group, sums in zip(splats.channels, images, strict=True):
            channels(context, band, group.values, sums)
    named = {
        name: (sums[k // 3], k % 3)
        for group, sums in zip(splats.channels, images, strict=True)
        for k, name in enumerate(group.names)
        if name
    }
    color = shade(context, view, depth, gbuffer, epsilon, named, shadows)
    return DeviceAovs(context, view, depth, gbuffer, color, named)
