"""Files appear whole or not at all: write under a temporary name, then rename."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from splatcl.errors import FileError


@contextmanager
def atomic_path(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Give a temporary path beside `path` with the same extension; rename it to `path` at the end.

    The temporary file exists, empty, from the start. Whatever is raised inside, it is removed and `path` is
    as it was. A symbolic link is followed: the file it points to is replaced.

    Parameters
    ----------
    path : path
        Where the file shall be.

    Raises
    ------
    FileError
        The path is a folder or a device, its folder is missing or read-only, the disk is full, or any other
        operating system error inside the block.
    """
    try:
        target = _checked_target(path)
        temporary = target.with_name(f".splatcl-{secrets.token_hex(6)}{target.suffix}")
        try:
            os.close(os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666))
            yield temporary
            temporary.replace(target)
        except BaseException:
            with suppress(OSError):
                temporary.unlink()
            raise
    except OSError as error:
        raise _write_error(path, error) from error


def check_writable(path: str | os.PathLike[str]) -> None:
    """Raise `FileError` now if a file could not be written at `path`; nothing is left behind or changed."""
    try:
        target = _checked_target(path)
        probe = target.with_name(f".splatcl-{secrets.token_hex(6)}")
        os.close(os.open(probe, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666))
        probe.unlink()
    except OSError as error:
        raise _write_error(path, error) from error


def _checked_target(path: str | os.PathLike[str]) -> Path:
    try:
        target = Path(path).resolve()
        exists = target.exists()
    except (ValueError, RuntimeError) as error:  # a null byte in the name; a loop of symbolic links
        raise FileError(f"{os.fspath(path)!r}: cannot write: {error}") from None
    if exists and target.is_dir():
        raise FileError(f"{path}: cannot write: it is a folder")
    if exists and not target.is_file():
        raise FileError(f"{path}: cannot write: it is not a regular file")
    if exists and not os.access(target, os.W_OK):
        raise FileError(f"{path}: cannot write: the file is read-only")
    if not target.parent.exists():
        raise FileError(f"{path}: cannot write: the folder {target.parent} does not exist")
    return target


def _write_error(path: str | os.PathLike[str], error: OSError) -> FileError:
    return FileError(f"{path}: cannot write: {error.strerror or error}")
