"""Splats of the PLY files of 3D and 2D Gaussian Splatting (Kerbl et al. 2023, Huang et al. 2024)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splatcl.io.readers.color import linear_color, srgb_to_linear
from splatcl.io.readers.model import RGB, XYZ, Model, stack_columns

COLUMNS = frozenset(("x", "y", "z", "scale_0", "scale_1", "rot_0", "rot_1", "rot_2", "rot_3"))
"""Properties that identify a file of Gaussians."""
SH_C0 = 0.28209479177387814
"""Value of the constant spherical harmonic: color = 0.5 + SH_C0 f_dc."""
NUM_SIGMA = 2.0
"""Radius of a disc, standard deviations."""


def from_columns(path: Path, kind: str, columns: dict[str, NDArray[Any]], notes: list[str]) -> Model:
    """Make a splat of each Gaussian: the disc of its two longest axes, out to 2 sigma.

    The file has logarithms of scales, quaternions w x y z, and colors as spherical harmonics, sRGB; only their
    constant term counts. Opacity is ignored: surfaces are opaque.
    """
    num_axes = 3 if "scale_2" in columns else 2
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        sigma = np.exp(_numbered(columns, "scale_", num_axes))
        quaternion = _numbered(columns, "rot_", 4)
        axes = rotation_columns(quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True))
        longest = np.argsort(-sigma, axis=1, kind="stable")[:, :2]
        rows = np.arange(len(sigma))[:, None]
        discs = (NUM_SIGMA * sigma[rows, longest, None] * axes[rows, longest]).astype(np.float32)
    color = None
    if all(f"f_dc_{i}" in columns for i in range(3)):
        color = srgb_to_linear(0.5 + SH_C0 * _numbered(columns, "f_dc_", 3))
    elif (stored := stack_columns(columns, RGB)) is not None:
        color = linear_color(stored, notes)
    ignored = ["opacity"] if "opacity" in columns else []
    ignored += ["view-dependent color (f_rest)"] if "f_rest_0" in columns else []
    also = f"; ignored {' and '.join(ignored)}" if ignored else ""
    notes.append(f"read Gaussians as opaque discs of {NUM_SIGMA:g} sigma{also}")
    return Model(
        path,
        f"{kind[:-1]}, {num_axes}D Gaussians)",
        stack_columns(columns, XYZ),
        color=color,
        tangents=(discs[:, 0], discs[:, 1]),
        oriented=False,
        notes=tuple(notes),
    )


def _numbered(columns: dict[str, NDArray[Any]], prefix: str, num: int) -> NDArray[np.float64]:
    """Stack the columns `prefix`0, `prefix`1, ... to an (N, num) array."""
    with np.errstate(invalid="ignore"):  # a file may hold a signaling NaN
        return np.stack([columns[f"{prefix}{i}"] for i in range(num)], axis=1).astype(np.float64)


def rotation_columns(quaternion: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (N, 3, 3) rotated axes for (N, 4) unit quaternions w x y z: row i is column i of the rotation matrix."""
    w, x, y, z = quaternion.T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)],
        [2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)],
        [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)
