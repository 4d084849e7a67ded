"""The command line. Exit status: 0 done, 1 the run failed, 2 the user's mistake, 130 interrupted."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Sequence

from cyclopts import App, CycloptsError, Parameter

from splatcl.errors import CheckError, SplatclError

FAILED, MISTAKE, INTERRUPTED = 1, 2, 130


def _version() -> str:
    from importlib.metadata import version

    return f"splatcl {version('splatcl')}"


app = App(
    name="splatcl",
    help="Reference software rasterizer for surface splatting, in OpenCL.",
    version=_version,
    help_format="plaintext",
    suppress_keyboard_interrupt=False,
    # No --no-... flags; a tuple takes all the values that follow; lights are for Python only.
    default_parameter=Parameter(negative=(), consume_multiple=True, parse=re.compile("^(?!lights)")),
)
COMMANDS = {
    "render": "Render a scan to an OpenEXR file, a PNG, or both.",
    "probe": "Explain one pixel: every splat that touches it, and what became of it.",
    "info": "Say what a scan holds and what of it would be left out.",
    "doctor": "Test a device's arithmetic and its golden images.",
    "devices": "List the OpenCL devices and mark the one that is used.",
}
"""Each is a function in the file of its name, imported only when it is run."""

for name, summary in COMMANDS.items():
    app.command(f"splatcl.cli.{name}:{name}", name=name, help=summary)


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
        # The interpreter flushes stdout once more at its end: let that go nowhere.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return FAILED
    except CycloptsError as error:
        return _report(" ".join(str(error).split()), MISTAKE)
    except SplatclError as error:
        return _report(str(error), MISTAKE)
    except (OSError, MemoryError, CheckError) as error:
        return _report(str(error) or "out of memory", FAILED)
    except KeyboardInterrupt:
        return INTERRUPTED


def _report(message: str, status: int) -> int:
    print(f"splatcl: error: {message}", file=sys.stderr)
    return status
