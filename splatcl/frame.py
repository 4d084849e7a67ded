"""Frame: what a render returns, named AOVs and how they were made."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from splatcl.scene.camera import Camera
from splatcl.errors import FileError, SplatclError
from splatcl.scene.settings import RenderSettings

if TYPE_CHECKING:
    from splatcl.evidence.accounting import Check
    from splatcl.evidence.probe_report import Probe
    from splatcl.opencl.session import UploadedSplats
    from splatcl.renderer import Renderer
    from splatcl.scene.splats import Splats

OUTPUT_FORMATS = (".exr", ".png")
MARGINS = ("margin", "margin.raw")


class Frame:
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
        self.rendered_from: tuple[Renderer, Splats | UploadedSplats] | None = None
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

    def keys(self) -> tuple[str, ...]:
        """Names of the AOVs."""
        return tuple(dict.fromkeys((*self._aovs, *self._added)))

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
            write_exr(path, self)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Frame:
        """Read a frame that splatcl wrote as .exr, to look at or to `shade` again; see `splatcl.read_frame`."""
        from splatcl.frame import read_frame

        return read_frame(path)

    def shade(self, settings: RenderSettings | None = None, **changes: Any) -> Frame:
        """Return this frame lit and shaded anew from its AOVs, without its splats (docs/shaders.md).

        A frame of `render` gets the same bits as a fresh render with the same settings, also after it was saved as
        .exr and loaded, but for double precision, which the file rounds.

        Parameters
        ----------
        settings : RenderSettings, optional
            Shader, lights, material and the like are taken from here; the frame's own by default. What is not of
            shading must be as it was for this frame, or as the defaults are.
        **changes
            Fields of `settings` to change, such as ``shader="npr"``.

        Raises
        ------
        SplatclError
            The frame lacks P, N or albedo (eye space, (H, W, 3)), or its lighting is blended already.
        SettingsError
            The change needs a new render, or the shader does not compile.
        """
        from splatcl.opencl.relight import relight

        return relight(self, settings, changes)

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

        return probe(self, x, y)

    def check(self) -> tuple[Check, ...]:
        """Render again and account for every splat, record, fragment and colour; see docs/probe.md.

        The results are also put into `metadata["checks"]`. `SplatclError` as for `probe`.
        """
        from splatcl.evidence.accounting import check

        return check(self)

    def add_margin(self) -> None:
        """Add the AOVs "margin" and "margin.raw": how near each pixel's decisions are to flipping.

        See `splatcl.uncertainty.margin`; `SplatclError` as for `probe`.
        """
        from splatcl.evidence.margin import margin

        renderer, splats = self.origin("add a margin to")
        arguments = renderer.resident(splats), self.camera, self.settings, self.metadata["epsilon"]
        self._added |= dict(zip(MARGINS, renderer.call(margin, *arguments), strict=True))

    def add_envelope(self, tolerance: float | None = None) -> None:
        """Add the bounds within which every correct renderer lands: Z.lo, Z.hi, and of weight, albedo and N.

        See `splatcl.envelope.envelope`, also for `tolerance`; `SplatclError` as for `probe`.
        """
        from splatcl.evidence.host.envelope import TOLERANCE
        from splatcl.evidence.envelope import envelope

        tolerance = TOLERANCE if tolerance is None else tolerance
        renderer, splats = self.origin("add an envelope to")
        arguments = renderer.resident(splats), self.camera, self.settings, self.metadata["epsilon"], tolerance
        self._added |= renderer.call(envelope, *arguments)
        self.metadata["envelope_tolerance"] = tolerance

    def origin(self, purpose: str) -> tuple[Renderer, Splats | UploadedSplats]:
        """Return the renderer and the splats that the frame was rendered with; `purpose` is what for."""
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
