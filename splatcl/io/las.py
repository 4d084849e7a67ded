"""LAS and LAZ surveys through laspy."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from splatcl.errors import FileError
from splatcl.io.color import srgb_to_linear
from splatcl.io.model import Model, foreign_errors, require

RGB = ("red", "green", "blue")


def read_las(path: Path) -> Model:
    """Read a LAS or LAZ file: float64 coordinates, 16-bit sRGB colours.

    Many writers put 8-bit colours into the 16-bit fields; where no value is above 255 they are taken as such.

    Raises
    ------
    FileError
        laspy is missing, the file is damaged or cut, or has no points.
    """
    laspy = require(path, "laspy", "las")
    notes: list[str] = []
    with foreign_errors(path, f"{path.suffix.lstrip('.').upper()} file", notes):
        survey = laspy.read(path)
        points = np.array(survey.xyz, np.float64)
        announced = survey.header.point_count
        present = set(survey.point_format.dimension_names)
        color = np.stack([survey[name] for name in RGB], axis=1) if present.issuperset(RGB) else None
        head = survey.header
        kind = f"{path.suffix.lstrip('.').upper()} {head.version}, point format {head.point_format.id}"
    if len(points) != announced:
        raise FileError(f"{path}: announces {announced} points but has {len(points)}; it was cut")
    if color is not None and not color.any():
        notes.append("ignored colours: all are zero")
        color = None
    if color is not None:
        eight = color.max() <= 255
        if eight:
            notes.append("colours are 8-bit values in 16-bit fields")
        color = srgb_to_linear(color / (255.0 if eight else 65535.0))
    return Model(path, kind, points, color=color, notes=tuple(notes))
