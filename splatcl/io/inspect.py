"""inspect: what a file holds and what of it would be left out, before anything is estimated."""

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
from splatcl.scene.splats import MAX_MAGNITUDE, invalid_splats
from splatcl.scene.splats import REASONS as SPLAT_REASONS


@dataclass(frozen=True, eq=False)
class Summary:
    """What a file holds.

    Parameters
    ----------
    path : Path
    format : str
        For people: "PLY (ascii)".
    num_points : int
        Points, mesh vertices or splats.
    num_faces : int
        Triangles.
    bounds : (2, 3) float64 array
        Least and greatest corner of the usable points' bounding box, world space; zeros where there are none.
    attributes : tuple of str
        Which of normals, color, radius, tangents and face color are present.
    spacing : float
        Median distance of a point to its nearest neighbor, scene units; 0 where there is no neighbor.
    skipped : tuple of (int, str)
        How many points, triangles or splats ``read(path, on_invalid="drop")`` leaves out, and why.
    notes : tuple of str
        What reading converted, assumed or ignored.
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
    """Read a file without making splats of it, and say what it holds.

    Raises
    ------
    FileError
        As `read`.
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
    return tuple((int(n), f"{kind} with {reasons[r]}") for r, n in enumerate(np.bincount(reason)) if r and n)


def _color(model: Model) -> NDArray[np.floating]:
    return np.zeros((len(model.points), 3)) if model.color is None else model.color
