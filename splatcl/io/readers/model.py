"""Model: the content of a file before splats are made of it; and the errors of reading one."""

from __future__ import annotations

import errno
import importlib
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splatcl.errors import FileError, SplatclError
from splatcl.prepare.meshes import face_out_of_range

XYZ, RGB = ("x", "y", "z"), ("red", "green", "blue")
"""Names of the columns of a position and of a color."""


@dataclass(frozen=True, eq=False)
class Model:
    """Points, a mesh or splats as in a file; colors are already linear.

    Parameters
    ----------
    path : Path
    format : str
        Name of the format for people: "PLY (ascii)".
    points : (N, 3) float array
        Points, mesh vertices or centers of splats, world space, scene units; float32 or float64 as in the file.
    normals : (N, 3) float array, optional
        World space, any length.
    color : (N, 3) float array, optional
        Linear RGB.
    radius : (N,) float array, optional
        Disc radii, scene units.
    tangents : pair of (N, 3) float arrays, optional
        Tangent axes of whole splats, world space, scene units.
    optional : dict of str to array
        Optional arrays of whole splats, named as in `Splats.optional`.
    faces : (F, 3) int64 array, optional
        Triangles, counterclockwise seen from outside.
    face_color : (F, 3) float array, optional
        Linear RGB.
    oriented : bool
        False if the signs of the splats' normals are arbitrary.
    num_dropped : int
        Number of invalid splats dropped before the file was written.
    notes : tuple of str
        One sentence for each conversion, assumption and omission.

    Raises
    ------
    FileError
        There are no points, or a face index is out of range.
    """

    path: Path
    format: str
    points: NDArray[Any]
    normals: NDArray[Any] | None = None
    color: NDArray[Any] | None = None
    radius: NDArray[Any] | None = None
    tangents: tuple[NDArray[Any], NDArray[Any]] | None = None
    faces: NDArray[np.int64] | None = None
    face_color: NDArray[Any] | None = None
    oriented: bool = True
    num_dropped: int = 0
    notes: tuple[str, ...] = ()
    optional: dict[str, NDArray[Any]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.normals is not None and len(self.normals) and not self.normals.any():
            object.__setattr__(self, "normals", None)
            object.__setattr__(self, "notes", (*self.notes, "ignored normals: all are zero"))
        if not len(self.points) and self.tangents is None:
            raise FileError(f"{self.path}: has no points")
        if self.faces is not None:
            problem = face_out_of_range(self.faces, len(self.points))
            if problem:
                raise FileError(f"{self.path}: {problem}; the file is damaged or truncated")


def stack_columns(columns: Mapping[str, NDArray[Any]], names: Sequence[str]) -> Any:
    """Stack the named (N,) columns to a native (N, K) array; return None if one is missing."""
    if not all(name in columns for name in names):
        return None
    return np.stack([columns[name] for name in names], axis=1)


def require(path: Path, module: str, extra: str) -> Any:
    """Import an optional library, or raise a `FileError` with the command that installs it."""
    try:
        return importlib.import_module(module)
    except ImportError:
        kind = path.suffix.lstrip(".").upper()
        raise FileError(f"{path}: cannot read {kind} without {module}; pip install 'splatcl[{extra}]'") from None


@contextmanager
def foreign_errors(path: Path, kind: str, notes: list[str]) -> Iterator[None]:
    """Turn any exception of a library into a `FileError`, and its warnings into notes.

    Parameters
    ----------
    path : Path
        The file that the library reads.
    kind : str
        The kind of file, for messages: "PLY file".
    notes : list of str
        Receives the warnings.
    """
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        # These two concern the library's authors only.
        warnings.simplefilter("ignore", ResourceWarning)
        warnings.simplefilter("ignore", DeprecationWarning)
        try:
            yield
        except (SplatclError, KeyboardInterrupt, SystemExit):
            raise
        except OSError as error:
            if error.errno in (errno.EIO, errno.ENOSPC, errno.EDQUOT):  # not the file's fault
                raise
            raise FileError(f"{path}: not a readable {kind} ({_one_line(error)})") from None
        except MemoryError:
            raise FileError(f"{path}: not a readable {kind}: its counts exceed the memory") from None
        except BaseException as error:  # a panic of lazrs is no Exception
            raise FileError(f"{path}: not a readable {kind} ({_one_line(error)})") from None
    notes.extend(sorted({f"{kind}: {' '.join(str(w.message).split())[:300]}" for w in caught}))


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split())[:300] or type(error).__name__
