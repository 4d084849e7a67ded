"""The splats of 3D and 2D Gaussian Splatting files (Kerbl et al. 2023, Huang et al. 2024)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splatcl.io.readers.color import linear_color, srgb_to_linear
from splatcl.io.readers.model import Model

COLUMNS = frozenset(("x", "y", "z", "scale_0", "scale_1", "rot_0", "rot_1", "rot_2", "rot_3"))
SH_C0 = 0.28209479177387814
"""The constant spherical harmonic: color = 0.5 + SH_C0 f_dc."""
NUM_SIGMA = 2.0
"""A disc's rim, in standard deviations."""


def from_columns(path: Path, kind: str, columns: dict[str, NDArray[Any]], notes: list[str]) -> Model:
    """Make splats of Gaussians: the disc of the two longest axes, out to 2 sigma.

    Scales are logarithms, the quaternion is w x y z, and the color is the constant term of spherical harmonics,
    sRGB. Opacity has no meaning for an opaque surface and is ignored.
    """
    num_axes = 3 if "scale_2" in columns else 2
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        sigma = np.exp(_stack(columns, "scale_", num_axes))
        quaternion = _stack(columns, "rot_", 4)
        axes = rotation_columns(quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True))
        longest = np.argsort(-sigma, axis=1, kind="stable")[:, :2]
        rows = np.arange(len(sigma))[:, None]
        discs = (NUM_SIGMA * sigma[rows, longest, None] * axes[rows, longest]).astype(np.float32)
    color = None
    if all(f"f_dc_{i}" in columns for i in range(3)):
        color = srgb_to_linear(0.5 + SH_C0 * _stack(columns, "f_dc_", 3))
    elif all(name in columns for name in ("red", "green", "blue")):
        color = linear_color(np.stack([columns[n] for n in ("red", "green", "blue")], axis=1), notes)
    ignored = ["opacity"] if "opacity" in columns else []
    ignored += ["view-dependent color (f_rest)"] if "f_rest_0" in columns else []
    also = f"; ignored {' and '.join(ignored)}" if ignored else ""
    notes.append(f"read Gaussians as opaque discs of {NUM_SIGMA:g} sigma{also}")
    return Model(
        path,
        f"{kind[:-1]}, {num_axes}D Gaussians)",
        np.stack([columns[name] for name in "xyz"], axis=1),
        color=color,
        tangents=(discs[:, 0], discs[:, 1]),
        oriented=False,
        notes=tuple(notes),
    )


def _stack(columns: dict[str, NDArray[Any]], prefix: str, num: int) -> NDArray[np.float64]:
    with np.errstate(invalid="ignore"):  # signaling NaN
        return np.stack([columns[f"{prefix}{i}"] for i in range(num)], axis=1).astype(np.float64)


def rotation_columns(quaternion: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (N, 3, 3) rotated axes for (N, 4) unit quaternions w x y z: row i is the rotation matrix's column i."""
    w, x, y, z = quaternion.T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)],
        [2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)],
        [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)
