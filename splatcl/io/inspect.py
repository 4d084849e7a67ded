"""inspect: the content of a file and its unusable items, without making splats."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from splatcl.io.read import load_model
from splatcl.io.readers.model import Model
from splatcl.prepare.meshes import REASONS as TRIANGLE_REASONS
from splatcl.prepare.meshes import invalid_triangles
from splatcl.prepare.points import REASONS as POINT_REASONS
from splatcl.prepare.points import estimate_spacing, invalid_points
from splatcl.scene.splats import MAX_MAGNITUDE, invalid_splats, reason_counts
from splatcl.scene.splats import REASONS as SPLAT_REASONS


@dataclass(frozen=True, eq=False)
class Summary:
    """The content of a file.

    Parameters
    ----------
    path : Path
    format : str
        Name of the format for people: "PLY (ascii)".
    num_points : int
        Number of points, mesh vertices or splats.
    num_faces : int
        Number of triangles.
    bounds : (2, 3) float64 array
        Least and greatest corner of the usable points' bounding box, world space; zeros without a usable point.
    attributes : tuple of str
        Those of normals, color, radius, tangents and face color that are present.
    spacing : float
        Median distance from a point to its nearest distinct neighbor, scene units; 0 without one.
    skipped : tuple of (int, str)
        Numbers of points, triangles or splats that ``read(path, on_invalid="drop")`` drops or skips, and the problems.
    notes : tuple of str
        One sentence for each conversion, assumption and omission of the reader.
    """

    path: Path
    format: str
    num_points: int
    num_faces: int
    bounds: NDArray[np.float64]
    attributes: tuple[str, ...]
    spacing: float
    skipped: tuple[tuple[int, str], ...]
    notes: tuple[str, ...]


def inspect(path: str | os.PathLike[str]) -> Summary:
    """Read a file and summarize its content, without making splats.

    Raises
    ------
    FileError
        The file cannot be read; as for `read`.
    """
    model = load_model(path)
    with np.errstate(invalid="ignore"):
        usable = model.points[(np.abs(model.points) <= MAX_MAGNITUDE).all(axis=1)].astype(np.float64)
    present = {
        "normals": model.normals,
        "color": model.color,
        "radius": model.radius,
        "tangents": model.tangents,
        "face color": model.face_color,
    }
    return Summary(
        path=model.path,
        format=model.format,
        num_points=len(model.points),
        num_faces=0 if model.faces is None else len(model.faces),
        bounds=np.stack([usable.min(axis=0), usable.max(axis=0)]) if len(usable) else np.zeros((2, 3)),
        attributes=tuple(name for name, value in present.items() if value is not None),
        spacing=estimate_spacing(usable),
        skipped=_skipped(model),
        notes=model.notes,
    )


def _skipped(model: Model) -> tuple[tuple[int, str], ...]:
    """Return the number of unusable items for each problem, and the problem."""
    kind: str
    reasons: tuple[str, ...]
    if model.tangents is not None:
        kind, reasons = "splats", SPLAT_REASONS
        reason = invalid_splats(model.points, *model.tangents, _color(model))
    elif model.faces is not None and len(model.faces):
        kind, reasons = "triangles", TRIANGLE_REASONS
        per_face = model.face_color is not None
        color = model.face_color if per_face else model.color
        reason = invalid_triangles(model.points, model.faces, color, per_face)
    else:
        kind, reasons = "points", POINT_REASONS
        reason = invalid_points(model.points, model.normals, model.color, model.radius)
    return tuple((count, f"{kind} with {text}") for text, count in reason_counts(reason, reasons))


def _color(model: Model) -> NDArray[np.floating]:
    return np.zeros((len(model.points), 3)) if model.color is None else model.color
