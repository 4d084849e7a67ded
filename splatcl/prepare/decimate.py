"""Fewer, larger splats within an error bound, in the spirit of [WK04].

A patch grows about each of many splats, over those around it, until one leaves the bounds; a greedy set cover chooses
patches that have all splats; each becomes the ellipse that holds its splats' discs (patches.py grows and chooses).
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
from splatcl.prepare.patches import Patches, Surface, cover, grow
from splatcl.prepare.voronoi import principal, tangent_frame
from splatcl.scene.splats import Splats

ANGLE = 30.0
"""Degrees by which normals may differ from that of the splat that covers them."""

NUM_CORNERS = 32
"""Of the polygon about a disc that an ellipse is made to hold: at most half a percent larger than needed."""


def decimate(splats: Splats, error: float, *, angle: float = ANGLE, fields: bool = False) -> Splats:
    """Cover splats with fewer, larger ones.

    Every center lies within `error` of the plane of an output splat whose ellipse holds its projection, and whose
    normal is within `angle` of its own. The ellipse holds the projection of its whole disc too, so that discs without
    holes become ellipses without holes. Colors and attributes are means by area of all that is under an ellipse.

    Parameters
    ----------
    splats : Splats
        Where their normals' signs mean nothing, those are ignored.
    error : float
        Largest distance of a covered center from the plane, scene units.
    angle : float
        Largest angle of a covered normal to the splat's, degrees, up to 60.
    fields : bool
        Fit normal fields to the normals of the splats over each ellipse (`fit_normal_fields`).

    Returns
    -------
    Splats
        Each stands for 2048 at most. Normal fields and clip lines are not carried over; a note says so.

    Raises
    ------
    SettingsError
        An error that is not positive, or an angle out of range.
    """
    if not (error > 0 and math.isfinite(error)):
        raise SettingsError(f"error {error} must be a positive distance, scene units")
    if not 0 < angle <= 60:
        raise SettingsError(f"angle {angle} must be above 0 and at most 60 degrees")
    if not len(splats):
        return splats
    surface = _surface(splats, error, math.radians(angle))
    patches = grow(surface)
    result = _ellipses(splats, surface, patches.take(cover(patches, len(splats))))
    return fit_normal_fields(result, splats.center, splats.normal) if fields else result


def _surface(splats: Splats, error: float, angle: float) -> Surface:
    from scipy.spatial import cKDTree

    center = splats.center.astype(np.float64)
    center -= center.mean(axis=0)
    area = np.linalg.norm(np.cross(splats.tangent_u.astype(np.float64), splats.tangent_v.astype(np.float64)), axis=1)
    return Surface(center, splats.normal, area, splats.oriented, cKDTree(center), error, angle)


def _ellipses(splats: Splats, surface: Surface, patches: Patches) -> Splats:
    """Return a splat for each patch: its plane halfway between the lowest and the highest center."""
    first, ids = patches.begin[:-1], patches.ids
    rows = np.repeat(np.arange(len(patches)), np.diff(patches.begin))
    normal = surface.normal[patches.seed]
    frame = np.stack([*tangent_frame(normal), normal])
    offset = surface.center[ids] - surface.center[patches.seed][rows]
    x, y, height = np.einsum("pi,fpi->fp", offset, frame[:, rows])
    tangents = np.stack([splats.tangent_u, splats.tangent_v])[:, ids].astype(np.float64)
    axes = np.einsum("tpi,fpi->tfp", tangents, frame[:2, rows])  # each disc's, in the frame
    area = surface.area[ids]
    middle, half = _bounding_ellipses(rows, area, np.stack([x, y]), axes)
    level = 0.5 * (np.maximum.reduceat(height, first) + np.minimum.reduceat(height, first))
    center = splats.center[patches.seed] + np.einsum("fn,fni->ni", np.stack([*middle, level]), frame)
    tangent_u, tangent_v = np.einsum("tfn,fni->tni", half, frame[:2]).astype(splats.tangent_u.dtype)
    total = np.bincount(rows, area)

    def mean(values: NDArray[Any]) -> NDArray[Any]:
        return (np.bincount(rows, area * values[ids]) / total).astype(values.dtype)

    lost = [
        name for name, there in (("normal fields", splats.normal_du), ("clip lines", splats.clip)) if there is not None
    ]
    error, angle = surface.error, math.degrees(surface.angle)
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
        notes=(*splats.notes, note, *(f"left out the {name} of the splats before" for name in lost)),
        on_invalid="error",
    )


def _bounding_ellipses(
    rows: NDArray[np.intp], area: NDArray[np.float64], place: NDArray[np.float64], axes: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return ellipses that hold the discs of each row, along the discs' principal axes.

    Parameters
    ----------
    rows : (P,) int array
        The ellipse that a disc goes into; 0 to N - 1, each there, in order.
    area : (P,) float64 array
        Weights of the discs.
    place : (2, P) float64 array
        The discs' centers in the plane of their ellipse.
    axes : (2, 2, P) float64 array
        Their half axes there: [t, f] is component f of axis t.

    Returns
    -------
    middle : (2, N) float64 array
        Centers.
    half : (2, 2, N) float64 array
        Half axes, the longer first, turning the same way as the frame.
    """
    total = np.bincount(rows, area)
    middle = np.stack([np.bincount(rows, area * p) for p in place]) / total
    x, y = place - middle[:, rows]
    (ux, uy), (vx, vy) = axes
    # A disc's own second moments are a quarter of its axes'.
    xx, xy, yy = (
        np.bincount(rows, area * (a * b + 0.25 * (c * d + e * f))) / total
        for a, b, c, d, e, f in ((x, x, ux, ux, vx, vx), (x, y, ux, uy, vx, vy), (y, y, uy, uy, vy, vy))
    )
    mean, spread, turn = principal(xx, xy, yy)
    cos, sin = np.cos(turn), np.sin(turn)
    long, short = np.sqrt(mean + spread), np.sqrt((xx * yy - xy * xy) / (mean + spread))
    # In units of the ellipse: its unit circle is to hold all discs.
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
