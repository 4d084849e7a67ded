"""``splatcl render``: a scan in, an OpenEXR file or a PNG out."""

from __future__ import annotations

import re
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter
from numpy.typing import ArrayLike

from splatcl.camera import Camera, Projection
from splatcl.errors import CameraError, CheckError, SettingsError
from splatcl.progress import stage
from splatcl.settings import RenderSettings
from splatcl.splats import OnInvalid, Splats

if TYPE_CHECKING:
    from splatcl.frame import Frame

Axis = Literal["x", "y", "z", "-x", "-y", "-z"]
DEFAULT_SIZE = "512x512"


@dataclass
class View:
    """Where to look from: a camera file, or a framing of the whole scan.

    Parameters
    ----------
    camera : path
        Camera file (docs/cameras.md); excludes the other options of this group.
    size : str
        Image size, WIDTHxHEIGHT pixels [default: 512x512].
    azimuth : float
        Degrees around the scan, counter-clockwise seen from above [default: 0].
    elevation : float
        Degrees above the scan [default: 0].
    fov : float
        Vertical angle of view, degrees [default: 45].
    up : str
        World axis that points up in the image [default: as the file's format has it].
    projection : str
        Perspective, or orthographic with what is seen at the scan's middle [default: perspective].
    """

    camera: Path | None = None
    size: str | None = None
    azimuth: float | None = None
    elevation: float | None = None
    fov: float | None = None
    up: Annotated[Axis | None, Parameter(allow_leading_hyphen=True)] = None
    projection: Projection | None = None

    def file_camera(self) -> Camera | None:
        """Return the camera of the file; where none is given check the other options and return None."""
        from splatcl.io.cameras import read_camera

        if self.camera is None:
            self.framing(((0.0, 0.0, 0.0), 1.0), "y")
            return None
        for name in ("size", "azimuth", "elevation", "fov", "up", "projection"):
            if getattr(self, name) is not None:
                raise CameraError(f"--camera and --{name} exclude each other: the camera file says it all")
        return read_camera(self.camera)

    def framing(self, sphere: tuple[ArrayLike, float], up: str) -> Camera:
        """Return a camera that sees all of a bounding sphere; `up` is the axis where no option gives one."""
        width, height = self.image_size()
        return Camera.framing(
            sphere,
            self.azimuth or 0.0,
            self.elevation or 0.0,
            axis_vector(self.up or up),
            45.0 if self.fov is None else self.fov,
            width,
            height,
            projection=self.projection or "perspective",
        )

    def image_size(self) -> tuple[int, int]:
        """Return width and height, pixels."""
        match = re.fullmatch(r"([1-9]\d{0,8})x([1-9]\d{0,8})", self.size or DEFAULT_SIZE)
        if not match:
            raise CameraError(f"--size {self.size!r} is not WIDTHxHEIGHT, such as 800x600")
        return int(match[1]), int(match[2])


def read_scan(
    scan: Path, on_invalid: OnInvalid, view: View, camera: Camera | None, say: Callable[[str], None] = print
) -> tuple[Splats, Camera]:
    """Return the splats of a file, and `camera` or else one that frames them; `say` what was done."""
    from splatcl import io

    start = time.perf_counter()
    with stage(f"Reading {scan.name}"):
        splats = io.read(scan, on_invalid)
    say(f"read {scan}: {len(splats)} splats in {_seconds_since(start)}")
    for note in splats.notes:
        say(f"note: {note}")
    if camera:
        return splats, camera
    framed = splats.without_outliers()
    if len(framed) < len(splats):
        say(f"note: framed without {len(splats) - len(framed)} strays, which are rendered all the same")
    return splats, view.framing(framed.bounding_sphere, io.up_axis(scan))


def axis_vector(axis: str) -> tuple[float, float, float]:
    """Return the unit vector of "x", "-z" ..."""
    sign = -1.0 if axis.startswith("-") else 1.0
    x, y, z = (sign * (axis[-1] == letter) for letter in "xyz")
    return x, y, z


def render(
    scan: Path,
    /,
    *,
    output: Annotated[Path | None, Parameter(alias="-o")] = None,
    png: Path | None = None,
    exposure: float = 0.0,
    view: Annotated[View | None, Parameter(name="*", group="Camera")] = None,
    settings: Annotated[RenderSettings | None, Parameter(name="*", group="Settings")] = None,
    on_invalid: OnInvalid = "error",
    device: str | None = None,
    tile_size: int = 16,
    check: bool = False,
    margin: bool = False,
    envelope: bool = False,
    allow_inexact: bool = False,
) -> None:
    """Render a scan to an OpenEXR file (every AOV), a PNG (the picture), or both.

    Parameters
    ----------
    scan : path
        PLY, text, mesh or other file that `splatcl info` knows.
    output : path
        .exr or .png file to write.
    png : path
        .png file to write.
    exposure : float
        Stops, for the PNG.
    on_invalid : str
        What to do with splats that have non-finite numbers or no area.
    device : str
        OpenCL device: an index of `splatcl devices`, or words of its name and version.
    tile_size : int
        Pixels; changes the speed, not the image.
    check : bool
        Render a second time and account for every splat, record, fragment and colour (docs/probe.md).
    margin : bool
        Add to the .exr how near each pixel's decisions are to flipping (docs/uncertainty.md).
    envelope : bool
        Add to the .exr the bounds within which every correct renderer lands (docs/uncertainty.md).
    allow_inexact : bool
        Render even where the device or the environment may change bits of the image (`splatcl doctor`); recorded.
    """
    import splatcl

    outputs = check_outputs(output, png, exposure)
    if (margin or envelope) and all(path.suffix.lower() != ".exr" for path in outputs):
        raise SettingsError("--margin and --envelope are for .exr: give -o FILE.exr")
    view, settings = view or View(), settings or RenderSettings()
    camera = view.file_camera()
    renderer = splatcl.Renderer(device=device, tile_size=tile_size, allow_inexact=allow_inexact)

    splats, camera = read_scan(scan, on_invalid, view, camera)

    start = time.perf_counter()
    with stage("Rendering"):
        frame = renderer.render(splats, camera, settings)
        covered = float((frame.color[..., 3] > 0).mean())
    took = _seconds_since(start)
    print(f"rendered {frame.width}x{frame.height} in {took}; splats cover {covered:.1%} of the image")
    print(f"device {frame.metadata['device']}")
    if "inexact" in frame.metadata:
        print(f"note: inexact: {frame.metadata['inexact']}")
    print(f"epsilon {frame.metadata['epsilon']:.6g}{' (auto)' if settings.epsilon == 'auto' else ''}")
    failed = _check(frame) if check else []
    with stage("Bounding the uncertainty"):
        if margin:
            frame.add_margin()
        if envelope:
            frame.add_envelope()
    save(frame, outputs, exposure)
    if failed:
        raise CheckError(f"{', '.join(failed)}: the check failed; the image is not to be trusted")


def _check(frame: Frame) -> list[str]:
    """Account for the frame, a line for each check; return the names of those that failed."""
    with stage("Checking"):
        checks = frame.check()
    for one in checks:
        print(f"check {one}")
    return [one.name for one in checks if not one.passed]


def check_outputs(output: Path | None, png: Path | None, exposure: float) -> list[Path]:
    """Return the files to write, after making sure that they can be written."""
    from splatcl.frame import output_format
    from splatcl.io.atomic import check_writable
    from splatcl.io.png import check_exposure

    outputs = [path for path in (output, png) if path is not None]
    if not outputs:
        raise SettingsError("nothing to write: give -o FILE.exr, --png FILE.png or both")
    if png is not None and output_format(png) != ".png":
        raise SettingsError(f"--png {png} does not end in .png")
    if output is not None and png is not None and output.resolve() == png.resolve():
        raise SettingsError(f"-o and --png both name {png}")
    check_exposure(exposure)
    if exposure and all(output_format(path) != ".png" for path in outputs):
        raise SettingsError("--exposure is for PNG; an .exr holds the linear values")
    for path in outputs:
        output_format(path)
        check_writable(path)
    return outputs


def save(frame: Frame, outputs: list[Path], exposure: float) -> None:
    """Write the frame to each output and say where it went."""
    from splatcl.frame import output_format

    for path in outputs:
        start = time.perf_counter()
        with stage(f"Writing {path.name}"):
            frame.save(path, exposure if output_format(path) == ".png" else 0.0)
        print(f"wrote {path} ({path.stat().st_size / 1e6:.2f} MB) in {_seconds_since(start)}")


def _seconds_since(start: float) -> str:
    return f"{time.perf_counter() - start:.2f} s"
