"""Frame: what a render returns, named AOVs and how they were made."""

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


class Frame(Mapping[str, NDArray[Any]]):
    """A rendered image: its AOVs by name (docs/specification.md, "AOVs").

    ``frame["Z"]`` is (H, W) float32 or uint32, ``frame["N"]`` (H, W, 3) float32, ``frame.color`` (H, W, 4)
    float32. Where nothing is, Z is +inf and particleid 0xFFFFFFFF.

    Parameters
    ----------
    aovs : mapping of str to array
        May compute its values when they are first asked for.
    camera : Camera
    settings : RenderSettings, optional
        Those of the render; the defaults for AOVs from elsewhere.
    metadata : dict
        What else the output shall record (JSON's types or NumPy numbers): the epsilon used, the device ...
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
        """Pixels."""
        return self.camera.width

    @property
    def height(self) -> int:
        """Pixels."""
        return self.camera.height

    @property
    def color(self) -> NDArray[Any]:
        """(H, W, 4) float32 linear RGB and alpha: 1 where a splat is, else 0.

        Supersampled, both are means over the samples: alpha is what splats cover of a pixel, and RGB is associated
        (premultiplied), as OpenEXR has it.
        """
        return self["color"]

    def __getitem__(self, name: str) -> NDArray[Any]:
        """Return an AOV; `SplatclError` names the choices if there is none of that name.

        "margin" and "margin.raw" are added when first asked for (`add_margin`).
        """
        if name in MARGINS and name not in self:
            self.add_margin()
        if name not in self:
            raise SplatclError(f"no AOV {name!r} in this frame; it has {', '.join(self)}")
        return self._added[name] if name in self._added else self._aovs[name]

    def __contains__(self, name: object) -> bool:
        return name in self.keys()  # a Mapping may compute the value to answer `in`

    def __iter__(self) -> Iterator[str]:
        return iter(self.keys())

    def __len__(self) -> int:
        return len(self.keys())

    __eq__ = object.__eq__  # a Mapping would compare arrays
    __hash__ = object.__hash__

    def keys(self) -> KeysView[str]:
        """Names of the AOVs."""
        return dict.fromkeys((*self._aovs, *self._added)).keys()

    def save(self, path: str | os.PathLike[str], exposure: float = 0.0) -> None:
        """Write every AOV as OpenEXR (.exr) or the picture as 8-bit sRGB (.png).

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
        SettingsError
            `exposure` is out of range.
        """
        from splatcl.io.exr import write_exr
        from splatcl.io.png import write_png

        suffix = output_format(path)
        if suffix == ".png":
            write_png(path, self._straight_color(), exposure)
        elif exposure:
            raise SplatclError(f"{path}: exposure is for .png; an .exr holds the linear values")
        else:
            write_exr(path, self, self.camera, self.settings, self.metadata)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Frame:
        """Read a frame that splatcl wrote as .exr, to look at or to `shade` again; see `splatcl.read_frame`."""
        return read_frame(path)

    def shade(
        self, settings: RenderSettings | None = None, *, renderer: Session | None = None, **changes: Any
    ) -> Frame:
        """Return this frame lit and shaded anew from its AOVs, without its splats (docs/guide/shaders.md).

        A frame of `render` gets the same bits as a fresh render with the same settings, also after it was saved as
        .exr and loaded, but for double precision, which the file rounds.

        Parameters
        ----------
        settings : RenderSettings, optional
            Shader, lights, material and the like are taken from here; the frame's own by default. What is not of
            shading must be as it was for this frame, or as the defaults are.
        renderer : Renderer, optional
            Shades on its device; the frame's own renderer by default, or one on the default device.
        **changes
            Fields of `settings` to change, such as ``shader="npr"``.

        Raises
        ------
        SplatclError
            The frame lacks P, N or albedo (eye space, (H, W, 3)), or its lighting is blended already.
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
        """Return this frame with other colors, the settings they were made with, and `metadata` added."""
        frame = Frame(self._aovs, self.camera, settings, self.metadata | metadata)
        frame.rendered_from = self.rendered_from
        frame._added = self._added | {"color": color}
        return frame

    def probe(self, x: int, y: int) -> Probe:
        """Explain a pixel: every splat that touches it or nearly does, and what became of it.

        The frame keeps its splats for this. `SplatclError` says so where the pixel is outside the image, or the
        frame has none: it was pickled or not rendered.
        """
        from splatcl.evidence.probe import probe

        session, uploaded = self.origin("probe")
        return probe(session, uploaded, self.camera, self.settings, self, x, y)

    def check(self) -> tuple[Check, ...]:
        """Render again and account for every splat, record, fragment and color; see docs/trust/probe.md.

        The results are also put into `metadata["checks"]`. `SplatclError` as for `probe`.
        """
        from splatcl.evidence.accounting import check

        session, uploaded = self.origin("check")
        checks = check(session, uploaded, self.camera, self.settings, self)
        self.metadata["checks"] = {one.name: one.verdict for one in checks}
        return checks

    def add_margin(self) -> None:
        """Add the AOVs "margin" and "margin.raw": how near each pixel's decisions are to flipping.

        See `splatcl.evidence.host.margin`; `SplatclError` as for `probe`.
        """
        from splatcl.evidence.margin import margin

        session, uploaded = self.origin("add a margin to")
        arguments = uploaded, self.camera, self.settings, self.metadata["epsilon"]
        self._added |= dict(zip(MARGINS, session.call(margin, *arguments), strict=True))

    def add_envelope(self, tolerance: float | None = None) -> None:
        """Add the bounds within which every correct renderer lands: Z.lo, Z.hi, and those of weight, albedo and N.

        See `splatcl.evidence.host.envelope`, also for `tolerance`; `SplatclError` as for `probe`.
        """
        from splatcl.evidence.envelope import envelope
        from splatcl.evidence.host.envelope import TOLERANCE

        tolerance = TOLERANCE if tolerance is None else tolerance
        session, uploaded = self.origin("add an envelope to")
        arguments = uploaded, self.camera, self.settings, self.metadata["epsilon"], tolerance
        self._added |= session.call(envelope, *arguments)
        self.metadata["envelope_tolerance"] = tolerance

    def origin(self, purpose: str) -> tuple[Session, UploadedSplats]:
        """Return the session and the splats that the frame was rendered with; `purpose` is what for."""
        if self.settings.supersampling > 1:
            raise SplatclError(
                f"cannot {purpose} a supersampled frame: decisions are made at samples, and its pixels are means of "
                f"{self.settings.supersampling**2} samples each; render with supersampling=1"
            )
        if self.rendered_from is None:
            raise SplatclError(
                f"cannot {purpose} a frame without its splats (it was read or unpickled); render it again"
            )
        return self.rendered_from

    def _repr_png_(self) -> bytes:
        from splatcl.io.png import encode_png

        return encode_png(self._straight_color())

    def _straight_color(self) -> NDArray[Any]:
        """Return `color` with straight alpha, as PNG has it; the two differ where alpha is neither 0 nor 1."""
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
    """Return ".exr" or ".png", the format that a path's extension asks for, or raise `FileError`."""
    suffix = Path(path).suffix.lower()
    if suffix not in OUTPUT_FORMATS:
        raise FileError(f"{path}: cannot write {suffix or 'a file without extension'}; use .exr or .png")
    return suffix


def read_frame(path: str | os.PathLike[str]) -> Frame:
    """Read a frame that splatcl wrote.

    Parameters
    ----------
    path : path
        .exr.

    Returns
    -------
    Frame
        AOVs as written (float32, uint32), camera and settings exactly, metadata as JSON has it. It has no splats, so
        it can be shaded again but not probed.

    Raises
    ------
    FileError
        The file is missing or damaged, not OpenEXR, or not from splatcl.
    SettingsError
        Its settings are of another version of splatcl.
    """
    aovs, camera, metadata = read_exr(path)
    if camera is None or "settings" not in metadata:
        raise FileError(f"{path}: splatcl did not write it: it has no camera and settings; make a Frame of its AOVs")
    try:
        settings = from_json(RenderSettings, metadata.pop("settings"))
    except (SettingsError, TypeError) as error:
        raise SettingsError(f"{path}: settings of another version of splatcl: {error}") from None
    return Frame(aovs, camera, settings, metadata)
