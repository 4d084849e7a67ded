"""The files that a command writes: images and splats."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from splatcl.cli.options.groups import FILES
from splatcl.errors import SettingsError
from splatcl.util.progress import stage

if TYPE_CHECKING:
    from splatcl.frame import Frame
    from splatcl.scene.splats import Splats

OutputOption = Annotated[
    Path | None,
    Parameter(group=FILES, alias="-o", help="File to write: .exr for every AOV, or .png for the picture."),
]
PngOption = Annotated[Path | None, Parameter(group=FILES, help=".png file to write.")]
ExposureOption = Annotated[float, Parameter(group=FILES, help="Exposure of the PNG, stops.")]
SplatsOption = Annotated[Path, Parameter(group=FILES, alias="-o", help=".ply or .npz file of splats to write.")]


def check_outputs(output: Path | None, png: Path | None, exposure: float) -> list[Path]:
    """Return the image files to write, after a check that each can be written."""
    from splatcl.frame import output_format
    from splatcl.io.png import check_exposure
    from splatcl.util.atomic import check_writable

    outputs = [path for path in (output, png) if path is not None]
    if not outputs:
        raise SettingsError("no output is named; give -o FILE.exr, --png FILE.png or both")
    if png is not None and output_format(png) != ".png":
        raise SettingsError(f"--png {png}: the name must end in .png; write .exr with -o")
    if output is not None and png is not None and output.resolve() == png.resolve():
        raise SettingsError(f"-o and --png both name {png}; give two names")
    check_exposure(exposure)
    if exposure and all(output_format(path) != ".png" for path in outputs):
        raise SettingsError("--exposure needs a PNG, since an .exr holds linear values; give --png FILE.png")
    for path in outputs:
        output_format(path)
        check_writable(path)
    return outputs


def save_images(frame: Frame, outputs: list[Path], exposure: float) -> None:
    """Write the frame to each output and print a line for each."""
    from splatcl.frame import output_format

    for path in outputs:
        _write(path, partial(frame.save, exposure=exposure if output_format(path) == ".png" else 0.0))


def save_splats(splats: Splats, path: Path, num_printed: int = 0) -> None:
    """Print the notes of splats after the first `num_printed`, write the splats and print a line for them."""
    from splatcl.io.write import write

    for note in splats.notes[num_printed:]:
        print(f"note: {note}")
    _write(path, partial(write, splats), f"{len(splats)} splats, ")


def seconds_since(start: float) -> str:
    """Return the time since `start` of ``time.perf_counter``, such as "0.52 s"."""
    return f"{time.perf_counter() - start:.2f} s"


def _write(path: Path, write: Callable[[Path], None], content: str = "") -> None:
    start = time.perf_counter()
    with stage(f"Writing {path.name}"):
        write(path)
    print(f"wrote {path} ({content}{path.stat().st_size / 1e6:.2f} MB) in {seconds_since(start)}")
