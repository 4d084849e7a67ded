"""The command line. Exit status: 0 done, 1 the run failed, 2 the user's mistake, 130 interrupted.

The library's errors name parameters of Python; `as_options` replaces them by options.
"""

from __future__ import annotations

import errno
import os
import re
import sys
from collections.abc import Sequence
from dataclasses import fields
from typing import Any

from cyclopts import App, CycloptsError, Group, Parameter

from splatcl.cli.options.groups import OWN
from splatcl.errors import CheckError, DeviceError, SplatclError
from splatcl.scene.settings import RenderSettings

FAILED, MISTAKE, INTERRUPTED = 1, 2, 130
MISTAKEN_PATH = frozenset(
    (errno.ENOENT, errno.EACCES, errno.EPERM, errno.EISDIR, errno.ENOTDIR, errno.ENAMETOOLONG, errno.ELOOP, errno.EROFS)
)
"""Errors of the system for a wrong path. Other errors, such as a full disk, fail the run."""
OPTIONS = {
    **{field.name: f"--{field.name.replace('_', '-')}" for field in fields(RenderSettings) if field.name != "lights"},
    **{name: f"--{name.replace('_', '-')}" for name in ("on_invalid", "tile_size", "allow_inexact", "exposure")},
    **{"azimuth": "--azimuth", "elevation": "--elevation", "up": "--up", "fov_y": "--fov", "image size": "--size"},
    **{"error": "--error", "angle": "--angle", "num_neighbors": "--num-neighbors"},
}
"""Option of each parameter of the library that errors name."""


def _version() -> str:
    from importlib.metadata import version

    return f"splatcl {version('splatcl')}"


def _as_typed(default: Any) -> str | None:
    """Return the default of an option as one would type it, None for an empty one."""
    if default is None or default is False or default == ():
        return None
    return " ".join(map(str, default)) if isinstance(default, tuple) else str(default)


START = """\
Start with a scan: splatcl render scan.ply -o scan.exr --png scan.png
Options of a command: splatcl COMMAND --help"""
RENDER_EXAMPLES = """\
Examples:

  Every AOV and the picture, from 20 degrees to the side and 10 above:
    splatcl render bunny.pts -o bunny.exr --png bunny.png \\
      --azimuth 20 --elevation 10

  Ground truth with evidence: accounting, decision margins and envelopes:
    splatcl render bunny.pts -o truth.exr --check --margin --envelope

  EWA splatting [ZRB04] instead of the default [BHZK05]:
    splatcl render bunny.pts -o ewa.exr --png ewa.png --method zwicker04

  A spot light that casts shadows, and 3 x 3 samples per pixel:
    splatcl render bunny.pts --png spot.png --supersampling 3 \\
      --light kind=spot,vector=0.3:0.5:0.4,direction=-0.7:-0.9:-0.9,shadow=pcf

  Normals as colors, orthographic, from above:
    splatcl render bunny.pts --png normals.png --shader normal \\
      --projection orthographic --elevation 90"""
"""End of ``splatcl render --help``; a test runs these commands."""

COMMANDS = {
    "Render": {
        "render": ("Render a scan to an OpenEXR file, a PNG, or both.", "See docs/guide/."),
        "shade": (
            "Shade a rendered OpenEXR file again, without its splats.",
            "Settings that are not given keep the values of the file. See docs/guide/shaders.md.",
        ),
        "probe": (
            "Explain one pixel: each splat that touches it, and its part in the result.",
            "See docs/trust/probe.md.",
        ),
    },
    "Prepare scans": {
        "info": ("Summarize a scan and its unusable points.", ""),
        "features": ("Make splats of a mesh that end at its sharp edges.", "See docs/guide/features.md."),
        "decimate": (
            "Cover a scan with fewer, larger splats within an error bound.",
            "See docs/guide/normal_fields.md.",
        ),
        "fields": ("Fit a normal field to each splat, for --method botsch04.", "See docs/guide/normal_fields.md."),
    },
    "Trust and speed": {
        "devices": ("List the OpenCL devices; a star marks the device in use.", ""),
        "doctor": (
            "Test a device's arithmetic and render the golden images on it.",
            "The exit status is 0 if the device is fit for reference renders, else 1. See docs/trust/doctor.md.",
        ),
        "paper": ("Rerun figures, tables and claims of the papers.", "See docs/trust/paper.md."),
        "bench": ("Measure the speed of rendering and its limits.", "See docs/speed/bench.md."),
    },
}
"""Each command's summary and details, by the title of its group. Its function is imported when it runs."""

app = App(
    name="splatcl",
    help="Reference software rasterizer for surface splatting, in OpenCL.",
    help_epilogue=START,
    version=_version,
    group_parameters=OWN,
    group_commands=Group("Help", sort_key=len(COMMANDS)),
    help_format="plaintext",
    suppress_keyboard_interrupt=False,
    # No --no-... flags; a tuple takes all the values that follow. --light and --user-shader replace the fields of
    # RenderSettings that hold lights and the text of a shader.
    default_parameter=Parameter(
        negative=(), consume_multiple=True, parse=re.compile("^(?!lights|user_shader)"), show_default=_as_typed
    ),
)
for place, (title, commands) in enumerate(COMMANDS.items()):
    group = Group(title, sort_key=place)
    for number, (name, (summary, details)) in enumerate(commands.items()):
        # A command with subcommands is an App and sets its own epilogue.
        epilogue = {} if name == "paper" else {"help_epilogue": RENDER_EXAMPLES if name == "render" else ""}
        app.command(
            f"splatcl.cli.commands.{name}:{name}",
            name=name,
            help=f"{summary}\n\n{details}",
            group=group,
            sort_key=number,
            **epilogue,
        )


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return the exit status.

    Parameters
    ----------
    arguments : sequence of str, optional
        Arguments without the program's name [default: those of the process].
    """
    try:
        status = app(
            sys.argv[1:] if arguments is None else arguments,
            exit_on_error=False,
            print_error=False,
            result_action="return_value",
        )
        sys.stdout.flush()
        return status or 0
    except BrokenPipeError:
        _abandon_stdout()
        return FAILED
    except CycloptsError as error:
        return _report(" ".join(str(error).split()), MISTAKE)
    except SplatclError as error:
        return _report(as_options(str(error)), FAILED if run_failed(error) else MISTAKE)
    except (OSError, MemoryError, CheckError) as error:
        _abandon_stdout()
        return _report(str(error) or "out of memory", FAILED)
    except KeyboardInterrupt:
        return INTERRUPTED


def _abandon_stdout() -> None:
    """Flush stdout; where it cannot be flushed, discard the rest, which the interpreter would flush at exit."""
    try:
        sys.stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def run_failed(error: SplatclError) -> bool:
    """Return True if the system or the OpenCL runtime failed, rather than the user."""
    cause = error.__cause__
    if isinstance(cause, OSError):
        return cause.errno not in MISTAKEN_PATH
    # pyopencl's errors are hidden behind ours, which quote them.
    return isinstance(cause, MemoryError) or (isinstance(error, DeviceError) and error.__context__ is not None)


def as_options(message: str) -> str:
    """Replace parameters in the text of an error by options: ``on_invalid='drop'`` by ``--on-invalid drop``.

    A word is a parameter if ``=`` follows it, if it has an underscore, or if it begins the text.
    """
    names = "|".join(sorted(map(re.escape, OPTIONS), key=len, reverse=True))
    message = re.sub(
        rf"(?<![\w./'\"-])({names})=(?:'([^']*)'|([\w.]+))",
        lambda found: f"{OPTIONS[found[1]]} {found[2] or found[3]}".removesuffix(" True"),
        message,
    )
    message = re.sub(rf"^({names})(?=[ .])", lambda found: OPTIONS[found[1]], message)
    compound = "|".join(name for name in OPTIONS if "_" in name)
    return re.sub(rf"(?<![\w./'\"-])({compound})(?![\w/=-]|\.\w)", lambda found: OPTIONS[found[1]], message)


def _report(message: str, status: int) -> int:
    print(f"splatcl: error: {message}", file=sys.stderr)
    return status
