"""``splatcl info``: what a file holds."""

from __future__ import annotations

from pathlib import Path


def info(file: Path, /) -> None:
    """Say what a scan holds, what would be estimated and what would be skipped.

    Parameters
    ----------
    file : path
        PLY, text, mesh or other scan.
    """
    from splatcl import io

    print(io.inspect(file))
