"""render(): splats and a camera in, a Frame out; Renderer keeps the device and its buffers between frames."""

from __future__ import annotations

from splatcl.frame import Frame
from splatcl.opencl.draw import draw
from splatcl.opencl.session import Session, UploadedSplats, default_session
from splatcl.scene.camera import Camera
from splatcl.scene.settings import RenderSettings
from splatcl.scene.splats import Splats


class Renderer(Session):
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

    def render(self, splats: Splats | UploadedSplats, camera: Camera, settings: RenderSettings | None = None) -> Frame:
        """Render one frame; see `render`."""
        return _render(self, splats, camera, settings)


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
    return _render(default_session(device), splats, camera, settings)


def _render(
    session: Session, splats: Splats | UploadedSplats, camera: Camera, settings: RenderSettings | None
) -> Frame:
    drawn = draw(session, splats, camera, RenderSettings() if settings is None else settings)
    frame = Frame(drawn.aovs, camera, drawn.settings, drawn.metadata)
    frame.rendered_from = (session, drawn.uploaded)
    return frame
