"""Frame: the result of a render, its named AOVs with the camera, the settings and the metadata."""

from __future__ import annotations

import os
from collections.abc import Iterator, KeysView, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from splatcl.errors import FileError, SettingsError, SplatclError
from splatcl.io.exr import from_json, read_exr
from splatcl.scene.camera import Camera
from splatcl.scene.settings import RenderSettings

if TYPE_CHECKING:
    from splatcl.evidence.accounting import Check
    from splatcl.evidence.probe_report import Probe
    from splatcl.opencl.session import Session, UploadedSplats

OUTPUT_FORMATS = (".exr", ".png")
MARGINS = ("margin", "margin.raw")
"""AOVs that `Frame.add_margin` computes."""


class Frame(Mapping[str, NDArray[Any]]):
    """A rendered image: its AOVs by name (docs/specification.md, "AOVs").

    ``frame["Z"]`` is (H, W) float32, ``frame["particleid"]`` (H, W) uint32, ``frame["N"]`` (H, W, 3) float32,
    ``frame.color`` (H, W, 4) float32. A pixel without a splat has Z = +inf and particleid = 0xFFFFFFFF.

    Parameters
    ----------
    aovs : mapping of str to array
        The AOVs by name; the mapping may compute a value at its first use.
    camera : Camera
    settings : RenderSettings, optional
        The settings of the render; the defaults for AOVs of another program.
    metadata : dict, optional
        Further facts to record (JSON's types or NumPy numbers): the epsilon used, the device and so on.
    """

    def __init__(
        self,
        aovs: Mapping[str, NDArray[Any]],
        camera: Camera,
        settings: RenderSettings | None = None,
        metadata: dict[str, Any] | None = None,
    ) -> None:
        self._aovs = aovs
        self.camera = camera
        self.settings = RenderSettings() if settings is None else settings
        self.metadata = dict(metadata or {})
        self.rendered_from: tuple[Session, UploadedSplats] | None = None
        self._added: dict[str, NDArray[Any]] = {}

    @property
    def width(self) -> int:
        """Width of the image, pixels."""
        return self.camera.width

    @property
    def height(self) -> int:
        """Height of the image, pixels."""
        return self.camera.height

    @property
    def color(self) -> NDArray[Any]:
        """(H, W, 4) float32 linear RGB and alpha; alpha is 1 where a splat is visible, else 0.

        In a supersampled frame both are means over the samples: alpha is the coverage of the pixel, and RGB is
        associated (premultiplied), as in OpenEXR.
        """
        return self["color"]

    def __getitem__(self, name: str) -> NDArray[Any]:
        """Return an AOV or raise `SplatclError`; "margin" and "margin.raw" are added at first use (`add_margin`)."""
        if name in MARGINS and name not in self:
            self.add_margin()
        if name not in self:
            raise SplatclError(f"the frame has no AOV {name!r}; it has {', '.join(self)}")
        return self._added[name] if name in self._added else self._aovs[name]

    def __contains__(self, name: object) -> bool:
        return name in self.keys()  # Mapping.__contains__ would compute the value

    def __iter__(self) -> Iterator[str]:
        return iter(self.keys())

    def __len__(self) -> int:
        return len(self.keys())

    __eq__ = object.__eq__  # Mapping.__eq__ would compare arrays
    __hash__ = object.__hash__

    def keys(self) -> KeysView[str]:
        """Return the names of the AOVs."""
        return dict.fromkeys((*self._aovs, *self._added)).keys()

    def save(self, path: str | os.PathLike[str], exposure: float = 0.0) -> None:
        """Write every AOV as OpenEXR (.exr), or the color as 8-bit sRGB (.png).

        The file appears whole or not at all; an existing file is replaced.

        Parameters
        ----------
        path : path
            The extension chooses the format.
        exposure : float
            Stops, for PNG only: RGB is multiplied by 2^exposure.

        Raises
        ------
        FileError
            The extension is neither .exr nor .png, or the file cannot be written.
        SplatclError
            `exposure` is out of range (`SettingsError`), or is given for an .exr.
        """
        from splatcl.io.exr import write_exr
        from splatcl.io.png import write_png

        suffix = output_format(path)
        if suffix == ".png":
            write_png(path, self._straight_color(), exposure)
        elif exposure:
            raise SplatclError(f"{path}: exposure must be 0 for .exr, whose values are linear; write a .png")
        else:
            write_exr(path, self, self.camera, self.settings, self.metadata)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Frame:
        """Read a frame from an .exr of splatcl; see `splatcl.read_frame`."""
        return read_frame(path)

    def shade(
        self, settings: RenderSettings | None = None, *, renderer: Session | None = None, **changes: Any
    ) -> Frame:
        """Light and shade this frame again from its AOVs, without its splats (docs/guide/shaders.md).

        The result has the bits of a new render with the same settings, also after `save` and `load`. In double
        precision a loaded frame differs: the file holds float32.

        Parameters
        ----------
        settings : RenderSettings, optional
            Shader, lights, material and other shading settings; the frame's own by default. Each setting that is not
            of shading must equal the frame's or the default.
        renderer : Renderer, optional
            Shades on its device. The default is the frame's own renderer, or one on the default device.
        **changes
            Fields of `settings` to change, such as ``shader="npr"``.

        Raises
        ------
        SplatclError
            The frame has no P, N or albedo (eye space, (H, W, 3)), or its lighting was blended.
        SettingsError
            The change needs a new render, or the shader does not compile.
        """
        from splatcl.opencl.relight import relight, shading_settings
        from splatcl.opencl.session import default_session

        wanted = shading_settings(self.settings, settings, changes)
        session, casters = self.rendered_from or (default_session(), None)
        session = renderer or session
        color, metadata = relight(session, self, self.camera, wanted, self.metadata.get("epsilon"), casters)
        return self.with_color(color, wanted, metadata)

    def with_color(self, color: NDArray[Any], settings: RenderSettings, metadata: dict[str, Any]) -> Frame:
        """Return a frame with these AOVs but another (H, W, 4) color, its settings, and `metadata` added."""
        frame = Frame(self._aovs, self.camera, settings, self.metadata | metadata)
        frame.rendered_from = self.rendered_from
        frame._added = self._added | {"color": color}
        return frame

    def probe(self, x: int, y: int) -> Probe:
        """Explain the pixel (x, y): list every splat that touches it or nearly does, with its fate in each pass.

        Raises `SplatclError` as `origin` does, and if the pixel is outside the image.
        """
        from splatcl.evidence.probe import probe

        session, uploaded = self.origin("probe")
        return probe(session, uploaded, self.camera, self.settings, self, (x, y))

    def check(self) -> tuple[Check, ...]:
        """Render again and account for every splat, record, fragment and color (docs/trust/probe.md).

        The verdicts are also recorded in ``metadata["checks"]``.
        Raises `SplatclError` as `origin` does.
        """
        from splatcl.evidence.accounting import check

        session, uploaded = self.origin("check")
        checks = check(session, uploaded, self.camera, self.settings, self)
        self.metadata["checks"] = {one.name: one.verdict for one in checks}
        return checks

    def add_margin(self) -> None:
        """Add the AOVs "margin" and "margin.raw", (H, W): each pixel's distance to a flipped decision.

        `splatcl.evidence.host.margin` defines them. Raises `SplatclError` as `origin` does.
        """
        from splatcl.evidence.margin import margin

        session, uploaded = self.origin("add a margin to")
        arguments = uploaded, self.camera, self.settings, self.metadata["epsilon"]
        self._added |= dict(zip(MARGINS, session.call(margin, *arguments), strict=True))

    def add_envelope(self, tolerance: float | None = None) -> None:
        """Add lower and upper bounds of every correct renderer's Z, weight, albedo and N: Z.lo, Z.hi and so on.

        `splatcl.evidence.host.envelope` defines them and `tolerance`. Raises `SplatclError` as `origin` does, and
        `SettingsError` if `tolerance` is out of range or the settings have no envelope.
        """
        from splatcl.evidence.envelope import envelope
        from splatcl.evidence.host.envelope import TOLERANCE

        tolerance = TOLERANCE if tolerance is None else tolerance
        session, uploaded = self.origin("add an envelope to")
        arguments = uploaded, self.camera, self.settings, self.metadata["epsilon"], tolerance
        self._added |= session.call(envelope, *arguments)
        self.metadata["envelope_tolerance"] = tolerance

    def origin(self, purpose: str) -> tuple[Session, UploadedSplats]:
        """Return the session and the splats of the render; `purpose` is a verb for the error: "probe".

        Raises `SplatclError` if the frame is supersampled, or has no splats because it was read or unpickled.
        """
        if self.settings.supersampling > 1:
            raise SplatclError(
                f"cannot {purpose} a supersampled frame: each pixel is a mean of {self.settings.supersampling**2} "
                "samples, which decide separately; render with supersampling=1"
            )
        if self.rendered_from is None:
            raise SplatclError(f"cannot {purpose} a frame without its splats (read or unpickled); render it again")
        return self.rendered_from

    def _repr_png_(self) -> bytes:
        from splatcl.io.png import encode_png

        return encode_png(self._straight_color())

    def _straight_color(self) -> NDArray[Any]:
        """Return `color` with straight alpha, as in PNG; it differs from associated where 0 < alpha < 1."""
        if self.settings.supersampling == 1:
            return self.color
        rgb, alpha = self.color[..., :3], self.color[..., 3:]
        return np.concatenate([rgb / np.where(alpha > 0, alpha, 1), alpha], axis=-1)

    def __repr__(self) -> str:
        return f"<Frame {self.width}x{self.height}: {', '.join(self)}>"

    def __getstate__(self) -> dict[str, Any]:
        return {
            **self.__dict__,
            "_aovs": {name: self._aovs[name] for name in self._aovs},
            "rendered_from": None,
        }


def output_format(path: str | os.PathLike[str]) -> str:
    """Return the extension of a path, ".exr" or ".png"; raise `FileError` for another one."""
    suffix = Path(path).suffix.lower()
    if suffix not in OUTPUT_FORMATS:
        raise FileError(f"{path}: cannot write {suffix or 'a file without extension'}; use .exr or .png")
    return suffix


def read_frame(path: str | os.PathLike[str]) -> Frame:
    """Read a frame from an OpenEXR file of splatcl.

    Parameters
    ----------
    path : path
        An .exr file.

    Returns
    -------
    Frame
        The AOVs as written (float32, uint32), the same camera and settings, the metadata as JSON returns it. The
        frame has no splats: it can be shaded again but not probed.

    Raises
    ------
    FileError
        The file is missing or damaged, is not OpenEXR, or is not from splatcl.
    SettingsError
        The settings are those of another version of splatcl.
    """
    aovs, camera, metadata = read_exr(path)
    if camera is None or "settings" not in metadata:
        raise FileError(f"{path}: has no camera and settings of splatcl; make a Frame of its AOVs")
    try:
        settings = from_json(RenderSettings, metadata.pop("settings"))
    except (SettingsError, TypeError) as error:
        raise SettingsError(f"{path}: has settings of another version of splatcl ({error}); render again") from None
    return Frame(aovs, camera, settings, metadata)
