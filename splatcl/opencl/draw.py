"""All passes of a frame, in order ([BHZK05] figure 1); read this module first.

`bin` lists the splats of each tile. `project` makes a record of each listed splat. `visibility` finds depth(p), the
depth of the nearest disc at pixel p. `attributes` sums the fragments within epsilon of depth(p). `shade` lights each
pixel once. Each pass has a module in passes/ and a kernel of the same name in kernels/passes/.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

from splatcl.opencl.aovs import DeviceAovs
from splatcl.opencl.passes.attributes import attribute_channels, attribute_images, attributes, named_channels
from splatcl.opencl.passes.bin import bin
from splatcl.opencl.passes.shade import shade, shading_metadata
from splatcl.opencl.passes.shadow import shadow
from splatcl.opencl.passes.visibility import project_and_find_depth
from splatcl.opencl.session import Session, UploadedSplats
from splatcl.opencl.state.buffers import Band, Raster, Shadows
from splatcl.opencl.state.context import PassContext, frame_buffers
from splatcl.opencl.state.lights import light_options
from splatcl.opencl.state.upload import DeviceSplats
from splatcl.opencl.supersampling import NEIGHBORS, supersampled
from splatcl.scene.camera import Camera
from splatcl.scene.settings import RenderSettings, effective_settings
from splatcl.scene.splats import Splats


@dataclass(frozen=True)
class Drawn:
    """A drawn frame: its AOVs, how they were made, and the splats that they show."""

    aovs: Mapping[str, NDArray[Any]]  # (H, W) or (H, W, channels), by name
    settings: RenderSettings  # in effect for these splats (`effective_settings`)
    metadata: dict[str, Any]
    uploaded: UploadedSplats  # prepared for the settings


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
        The AOVs stay on the device until they are first read. The metadata holds the epsilon in scene units, the
        device and the splats' notes.

    Raises
    ------
    SettingsError
        The settings have no meaning for these splats.
    DeviceError
        The image is too large for the device, or the device lacks the precision.
    """
    uploaded = session.as_uploaded(splats).prepared(settings)
    settings = effective_settings(settings, uploaded.splats.oriented)
    aovs, metadata = session.call(_draw, uploaded, camera, settings)
    return Drawn(aovs, settings, metadata, uploaded)


def _draw(
    session: Session, uploaded: UploadedSplats, camera: Camera, settings: RenderSettings
) -> tuple[Mapping[str, NDArray[Any]], dict[str, Any]]:
    """Draw the image in one piece, or window by window; return its AOVs and metadata. For `Session.call`."""
    epsilon, shadows = uploaded.epsilon(settings), None
    if "SHADOWS" in light_options(settings):
        context, splats = session.pass_inputs(uploaded, camera, settings)
        shadows = shadow(context, splats, uploaded.sphere, epsilon)

    def window(camera: Camera, first: tuple[int, int] = (0, 0)) -> DeviceAovs:
        context, splats = session.pass_inputs(uploaded, camera, settings, first)
        return _draw_window(context, splats, epsilon, shadows)

    n = settings.supersampling
    aovs = window(camera) if n == 1 else supersampled(camera, n, window, NEIGHBORS.get(settings.shader, 0))
    return aovs, _metadata(session, uploaded, settings, shadows)


def _draw_window(
    context: PassContext, splats: DeviceSplats, epsilon: float, shadows: Shadows | None = None
) -> DeviceAovs:
    """Run every pass for the context's window. `bin` yields bands of tiles, which bound the memory."""
    view = context.view(splats.origin)
    depth, gbuffer = frame_buffers(context)
    images = attribute_images(context, splats.attribute_groups)
    for lists in bin(context, view, splats):
        projected = project_and_find_depth(context, view, splats, lists, depth, epsilon)
        band = Band(view, lists, projected, depth, epsilon)
        attributes(context, band, gbuffer)
        attribute_channels(context, band, splats.attribute_groups, images)
    channels = named_channels(splats.attribute_groups, images)
    raster = Raster(view, depth, gbuffer, epsilon, channels)
    color = shade(context, raster, shadows)
    return DeviceAovs(context, raster, color)


def _metadata(
    session: Session, uploaded: UploadedSplats, settings: RenderSettings, shadows: Shadows | None
) -> dict[str, Any]:
    """Return the metadata of a render."""
    splats, device = uploaded.splats, session.device
    return {
        "epsilon": uploaded.epsilon(settings),
        "num_splats": len(splats),
        "num_dropped": splats.num_dropped,
        "notes": list(splats.notes),
        "device": f"{device.info.version}, {device.info.name}",
        **shading_metadata(device, settings, shadows),
    }
