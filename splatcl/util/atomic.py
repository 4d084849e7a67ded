"""Write files atomically: a file appears whole or not at all."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from splatcl.errors import FileError


@contextmanager
def atomic_path(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Create an empty temporary file beside `path`, with the same extension; rename it to `path` at the end.

    An exception inside the block removes the temporary file and leaves `path` unchanged. A symbolic link is
    followed: its target is replaced.

    Parameters
    ----------
    path : path
        The final path.

    Yields
    ------
    Path
        The temporary file.

    Raises
    ------
    FileError
        `path` is a folder, a device or read-only, its folder is missing or read-only, or the block raises an
        `OSError` (a full disk).
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
    """Raise `FileError` if a file cannot be written at `path`; the test leaves no file and changes none."""
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
    except (ValueError, RuntimeError) as error:  # a null byte in the name, or a loop of symbolic links
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
