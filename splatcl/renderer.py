"""render: splats and a camera to a Frame. Renderer: the same, with a device kept between frames."""

from __future__ import annotations

from splatcl.frame import Frame
from splatcl.opencl.draw import draw
from splatcl.opencl.session import Session, UploadedSplats, default_session
from splatcl.scene.camera import Camera
from splatcl.scene.settings import RenderSettings
from splatcl.scene.splats import Splats


class Renderer(Session):
    """Renders frames on one OpenCL device and keeps the device and its buffers between frames.

    Parameters
    ----------
    device : str or int, optional
        An index of `splatcl devices`, or words of the platform's, version's or device's name. The default is
        SPLATCL_DEVICE, then PoCL's CPU.
    tile_size : {8, 16, 32, 64}
        Side of a tile, pixels; changes speed only, never a bit of the image.
    lanes : {1, 4, 8, 16}, optional
        Vector width in single precision; changes speed only. The default is 8 on a CPU and 1 elsewhere. PoCL 3.0
        has no 16.
    mapping : {"tile", "pixel"}, optional
        Work of a work-item in the raster passes; changes speed only. The default is a tile on a CPU and a pixel
        elsewhere; ``mapping="pixel"`` needs ``lanes=1``.
    allow_inexact : bool
        Render even if the device's arithmetic is not strict or the environment injects compiler flags. The key
        "inexact" of the frame's metadata then gives the reason.

    Raises
    ------
    DeviceError
        No device matches, the device does not start, or its arithmetic is not strict (`splatcl doctor`).
    SettingsError
        The kernels do not support the tile size, the number of lanes or the mapping.
    """

    def render(self, splats: Splats | UploadedSplats, camera: Camera, settings: RenderSettings | None = None) -> Frame:
        """Render one frame; see `render`."""
        return _render(self, splats, camera, settings)


def render(
    splats: Splats, camera: Camera, settings: RenderSettings | None = None, *, device: str | int | None = None
) -> Frame:
    """Render splats in five passes: bin, project, visibility, attributes, shade ([BHZK05] figure 1).

    Parameters
    ----------
    splats : Splats
    camera : Camera
    settings : RenderSettings, optional
        The defaults of [BHZK05] if omitted.
    device : str or int, optional
        As for `Renderer`.

    Returns
    -------
    Frame
        `frame.color` (H, W, 4) float32 linear RGBA and every AOV by name.

    Raises
    ------
    SettingsError
        The settings contradict each other or do not fit these splats.
    DeviceError
        There is no usable device, or the image is too large for it.
    """
    return _render(default_session(device), splats, camera, settings)


def _render(
    session: Session, splats: Splats | UploadedSplats, camera: Camera, settings: RenderSettings | None
) -> Frame:
    drawn = draw(session, splats, camera, RenderSettings() if settings is None else settings)
    frame = Frame(drawn.aovs, camera, drawn.settings, drawn.metadata)
    frame.rendered_from = (session, drawn.uploaded)
    return frame
