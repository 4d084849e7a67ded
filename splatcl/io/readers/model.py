"""Model: what a file says, before anything is estimated; and the ways in which reading one fails."""

from __future__ import annotations

import errno
import importlib
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splatcl.errors import FileError, SplatclError
from splatcl.prepare.meshes import face_out_of_range


@dataclass(frozen=True, eq=False)
class Model:
    """Points, a mesh or splats as a file holds them; colors are already linear.

    Parameters
    ----------
    path : Path
    format : str
        For people: "PLY (ascii)".
    points : (N, 3) float array
        World space, scene units; float32 or float64 as the file has them.
    normals : (N, 3) float array, optional
    color : (N, 3) float array, optional
        Linear RGB.
    radius : (N,) float array, optional
        Disc radii, scene units.
    tangents : pair of (N, 3) float arrays, optional
        Tangent axes where the file holds whole splats.
    further : dict of str to array
        The optional arrays of whole splats by the names that `Splats` takes, attributes as ``attribute.NAME``.
    faces : (F, 3) int64 array, optional
        Triangles, counter-clockwise seen from outside.
    face_color : (F, 3) float array, optional
        Linear RGB.
    oriented : bool
        False where the signs of the splats' normals mean nothing.
    num_dropped : int
        Invalid splats that were left out before the file was written.
    notes : tuple of str
        What was converted, assumed or ignored.
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
    further: dict[str, NDArray[Any]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.normals is not None and len(self.normals) and not self.normals.any():
            object.__setattr__(self, "normals", None)
            object.__setattr__(self, "notes", (*self.notes, "ignored normals: all are zero"))
        if not len(self.points) and self.tangents is None:
            raise FileError(f"{self.path}: holds no points")
        if self.faces is not None:
            problem = face_out_of_range(self.faces, len(self.points))
            if problem:
                raise FileError(f"{self.path}: {problem}; the file is damaged or was cut")


def require(path: Path, module: str, extra: str) -> Any:
    """Import an optional library, or say how to install it."""
    try:
        return importlib.import_module(module)
    except ImportError:
        kind = path.suffix.lstrip(".").upper()
        raise FileError(f"{path}: reading {kind} needs {module}: pip install 'splatcl[{extra}]'") from None


@contextmanager
def foreign_errors(path: Path, what: str, notes: list[str]) -> Iterator[None]:
    """Turn whatever a library raises into a `FileError`, and what it warns of into notes."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        # Of use to the library's authors only.
        warnings.simplefilter("ignore", ResourceWarning)
        warnings.simplefilter("ignore", DeprecationWarning)
        try:
            yield
        except (SplatclError, KeyboardInterrupt, SystemExit):
            raise
        except OSError as error:
            if error.errno in (errno.EIO, errno.ENOSPC, errno.EDQUOT):  # no fault of the file
                raise
            raise FileError(f"{path}: not a readable {what} ({_one_line(error)})") from None
        except MemoryError:
            raise FileError(f"{path}: {what} asks for more memory than there is; its counts are damaged") from None
        except BaseException as error:  # a panic of lazrs is no Exception
            raise FileError(f"{path}: not a readable {what} ({_one_line(error)})") from None
    for text in sorted({f"{what}: {' '.join(str(w.message).split())[:300]}" for w in caught}):
        notes.append(text)


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split())[:300] or type(error).__name__
