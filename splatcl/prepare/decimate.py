"""Replace splats by fewer, larger ones within an error bound, in the spirit of [WK04].

Patches grow about many splats until a splat leaves the bounds. A greedy set cover chooses patches that contain all
splats (patches.py does both). Each chosen patch becomes the ellipse that contains the discs of its splats.

[WK04]: Wu & Kobbelt, Optimized Sub-Sampling of Point Sets for Surface Splatting, 2004.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splatcl.errors import SettingsError
from splatcl.prepare.normal_fields import fit_normal_fields
from splatcl.prepare.patches import Patches, Samples, cover, grow
from splatcl.prepare.voronoi import principal, tangent_frame
from splatcl.scene.splats import Splats

ANGLE = 30.0
"""Default largest angle of a covered normal to the normal of its splat, degrees."""

NUM_CORNERS = 32
"""Number of corners of the polygon about a disc: an ellipse that contains it is at most half a percent too large."""


def decimate(splats: Splats, error: float, *, angle: float = ANGLE, fields: bool = False) -> Splats:
    """Cover splats with fewer, larger ones.

    Some output splat covers each input splat: its plane is within `error` of the input's center, and its normal is
    within `angle` of the input's normal. Its ellipse contains the projection of the input's disc, so discs without
    holes become ellipses without holes. Colors and attributes are means, weighted by the discs' areas.

    Parameters
    ----------
    splats : Splats
        Signs of normals are ignored unless ``splats.oriented``.
    error : float
        Largest distance of a covered center from the plane, scene units.
    angle : float
        Largest angle of a covered normal to the output splat's normal, degrees, at most 60.
    fields : bool
        Fit normal fields to the normals of the input splats (`fit_normal_fields`).

    Returns
    -------
    Splats
        Each output splat covers at most 2048 input splats. Normal fields and clip lines are lost; a note says so.

    Raises
    ------
    SettingsError
        `error` is not positive or not finite, or `angle` is out of range.
    """
    if not (error > 0 and math.isfinite(error)):
        raise SettingsError(f"error {error} must be positive and finite, scene units")
    if not 0 < angle <= 60:
        raise SettingsError(f"angle {angle} must be above 0 and at most 60 degrees")
    if not len(splats):
        return splats
    samples = _samples(splats, error, math.radians(angle))
    patches = grow(samples)
    result = _ellipses(splats, samples, patches.take(cover(patches, len(splats))))
    return fit_normal_fields(result, splats.center, splats.normal) if fields else result


def _samples(splats: Splats, error: float, angle: float) -> Samples:
    from scipy.spatial import cKDTree

    center = splats.center.astype(np.float64)
    center -= center.mean(axis=0)
    area = np.linalg.norm(np.cross(splats.tangent_u.astype(np.float64), splats.tangent_v.astype(np.float64)), axis=1)
    return Samples(center, splats.normal, area, splats.oriented, cKDTree(center), error, angle)


def _ellipses(splats: Splats, samples: Samples, patches: Patches) -> Splats:
    """Return a splat for each patch; its plane is halfway between the lowest and the highest center."""
    first, ids = patches.begin[:-1], patches.ids
    rows = np.repeat(np.arange(len(patches)), np.diff(patches.begin))
    normal = samples.normal[patches.seed]
    frame = np.stack([*tangent_frame(normal), normal])
    offset = samples.center[ids] - samples.center[patches.seed][rows]
    x, y, height = np.einsum("pi,fpi->fp", offset, frame[:, rows])
    tangents = np.stack([splats.tangent_u, splats.tangent_v])[:, ids].astype(np.float64)
    axes = np.einsum("tpi,fpi->tfp", tangents, frame[:2, rows])
    area = samples.area[ids]
    middle, half = _bounding_ellipses(rows, area, np.stack([x, y]), axes)
    level = 0.5 * (np.maximum.reduceat(height, first) + np.minimum.reduceat(height, first))
    center = splats.center[patches.seed] + np.einsum("fn,fni->ni", np.stack([*middle, level]), frame)
    tangent_u, tangent_v = np.einsum("tfn,fni->tni", half, frame[:2]).astype(splats.tangent_u.dtype)
    total = np.bincount(rows, area)

    def mean(values: NDArray[Any]) -> NDArray[Any]:
        return (np.bincount(rows, area * values[ids]) / total).astype(values.dtype)

    optional = (("normal fields", splats.normal_du), ("clip lines", splats.clip))
    lost = [name for name, array in optional if array is not None]
    error, angle = samples.error, math.degrees(samples.angle)
    note = f"decimated {len(splats)} splats to {len(patches)}: error {error:.6g}, angle {angle:.6g} degrees"
    return replace(
        splats,
        center=center.astype(splats.center.dtype),
        tangent_u=tangent_u,
        tangent_v=tangent_v,
        color=np.stack([mean(channel) for channel in splats.color.T], axis=1),
        attributes={name: mean(values) for name, values in splats.attributes.items()},
        normal_du=None,
        normal_dv=None,
        clip=None,
        notes=(*splats.notes, note, *(f"dropped the {name} of the original splats" for name in lost)),
        on_invalid="error",
    )


def _bounding_ellipses(
    rows: NDArray[np.intp], area: NDArray[np.float64], center: NDArray[np.float64], axes: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the ellipses that contain the discs of each row, along the discs' principal axes.

    Parameters
    ----------
    rows : (P,) int array
        The ellipse of each disc, 0 to N - 1, in ascending order; each ellipse has a disc.
    area : (P,) float64 array
        Weights of the discs.
    center : (2, P) float64 array
        The discs' centers in the plane of their ellipse, scene units.
    axes : (2, 2, P) float64 array
        The discs' half axes in that plane: [t, f] is component f of axis t.

    Returns
    -------
    middle : (2, N) float64 array
        Centers, scene units.
    half : (2, 2, N) float64 array
        Half axes, the longer first, with the orientation of the frame.
    """
    total = np.bincount(rows, area)
    middle = np.stack([np.bincount(rows, area * c) for c in center]) / total
    x, y = center - middle[:, rows]
    (ux, uy), (vx, vy) = axes
    # The second moments of a disc with half axes u, v are (u u^T + v v^T) / 4.
    xx, xy, yy = (
        np.bincount(rows, area * (a * b + 0.25 * (c * d + e * f))) / total
        for a, b, c, d, e, f in ((x, x, ux, ux, vx, vx), (x, y, ux, uy, vx, vy), (y, y, uy, uy, vy, vy))
    )
    mean, spread, turn = principal(xx, xy, yy)
    cos, sin = np.cos(turn), np.sin(turn)
    long, short = np.sqrt(mean + spread), np.sqrt((xx * yy - xy * xy) / (mean + spread))
    # The map turns the ellipse into the unit circle; `farthest` is the factor by which the circle must grow.
    to_unit = np.array([[cos / long, sin / long], [-sin / short, cos / short]])[..., rows]
    px, py = np.einsum("fgp,gp->fp", to_unit, np.stack([x, y]))
    (ux, uy), (vx, vy) = np.einsum("fgp,tgp->tfp", to_unit, axes) / math.cos(math.pi / NUM_CORNERS)
    farthest = np.zeros(len(rows))
    for angle in 2 * np.pi * np.arange(NUM_CORNERS) / NUM_CORNERS:
        cos_angle, sin_angle = math.cos(angle), math.sin(angle)
        corner = np.hypot(px + cos_angle * ux + sin_angle * vx, py + cos_angle * uy + sin_angle * vy)
        np.maximum(farthest, corner, out=farthest)
    grow_by = np.zeros(len(total))
    np.maximum.at(grow_by, rows, farthest)
    return middle, np.array([[cos * long, sin * long], [-sin * short, cos * short]]) * grow_by
