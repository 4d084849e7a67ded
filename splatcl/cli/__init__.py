"""The command line. Exit status: 0 done, 1 the run failed, 2 the user's mistake, 130 interrupted.

Errors speak of Python's parameters, for whoever calls the library; here they are put as options.
"""

from __future__ import annotations

import errno
import os
import re
import sys
from collections.abc import Sequence
from dataclasses import fields

from cyclopts import App, CycloptsError, Parameter

from splatcl.errors import CheckError, DeviceError, SplatclError
from splatcl.scene.settings import RenderSettings

FAILED, MISTAKE, INTERRUPTED = 1, 2, 130
MISTAKEN_PATH = frozenset(
    (errno.ENOENT, errno.EACCES, errno.EPERM, errno.EISDIR, errno.ENOTDIR, errno.ENAMETOOLONG, errno.ELOOP, errno.EROFS)
)
"""What the system says of a path that the user got wrong; anything else, such as a full disk, fails the run."""
OPTIONS = {
    **{field.name: f"--{field.name.replace('_', '-')}" for field in fields(RenderSettings) if field.name != "lights"},
    **{name: f"--{name.replace('_', '-')}" for name in ("on_invalid", "tile_size", "allow_inexact", "exposure")},
    **{"azimuth": "--azimuth", "elevation": "--elevation", "up": "--up", "fov_y": "--fov", "image size": "--size"},
    **{"error": "--error", "angle": "--angle", "num_neighbors": "--num-neighbors"},
}
"""Parameters of the library and the options that set them."""


def _version() -> str:
    from importlib.metadata import version

    return f"splatcl {version('splatcl')}"


app = App(
    name="splatcl",
    help="Reference software rasterizer for surface splatting, in OpenCL.",
    version=_version,
    help_format="plaintext",
    suppress_keyboard_interrupt=False,
    # No --no-... flags; a tuple takes all the values that follow; lights are texts here (--light); a user's shader is a
    # text there and a file here.
    default_parameter=Parameter(negative=(), consume_multiple=True, parse=re.compile("^(?!lights|user_shader)")),
)
COMMANDS = {
    "render": "Render a scan to an OpenEXR file, a PNG, or both.",
    "shade": "Light a rendered OpenEXR file anew, without its splats.",
    "probe": "Explain one pixel: every splat that touches it, and what became of it.",
    "features": "Make splats of a mesh that end at its sharp edges.",
    "info": "Say what a scan holds and what of it would be left out.",
    "decimate": "Cover a scan with fewer, larger splats within an error bound.",
    "fields": "Estimate how normals turn over each splat, for --method botsch04.",
    "bench": "Measure how fast splats are rendered, and what bounds it.",
    "paper": "Rerun the papers' claims.",
    "doctor": "Test a device's arithmetic and its golden images.",
    "devices": "List the OpenCL devices and mark the one that is used.",
}
"""Each is a function in the file of its name, imported only when it is run."""

for name, summary in COMMANDS.items():
    app.command(f"splatcl.cli.commands.{name}:{name}", name=name, help=summary)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return the exit status.

    Parameters
    ----------
    arguments : sequence of str, optional
        Without the program's name; those of the process by default.
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
    """Flush stdout if that can be; else let what the interpreter flushes at its end go nowhere."""
    try:
        sys.stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def run_failed(error: SplatclError) -> bool:
    """Whether an error comes from the system or the OpenCL runtime failing, and not from what was given."""
    cause = error.__cause__
    if isinstance(cause, OSError):
        return cause.errno not in MISTAKEN_PATH
    # pyopencl's errors are hidden behind ours, which quote them.
    return isinstance(cause, MemoryError) or (isinstance(error, DeviceError) and error.__context__ is not None)


def as_options(message: str) -> str:
    """Return an error's text with the library's parameters as options: ``on_invalid='drop'`` as ``--on-invalid drop``.

    A name is one where ``=`` follows, where it has an underscore, or at the beginning of the text.
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
