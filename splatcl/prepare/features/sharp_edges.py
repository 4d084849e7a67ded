"""Sharp edges of a mesh: where its faces meet at an angle, end, or are more than two."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

Array = NDArray[Any]


@dataclass(frozen=True, eq=False)
class SharpEdges:
    """Each sharp edge once for every face that it bounds, world space.

    Patches are what sharp edges part a mesh into: faces joined by smooth edges are of one patch.
    """

    start: Array  # (E, 3)
    end: Array  # (E, 3)
    inward: Array  # (E, 3) unit vectors in the face's plane, at right angles to the edge, toward the face
    normal: Array  # (E, 3) the face's unit normal
    patch: Array  # (E,) the face's patch
    patch_of_face: Array  # (F,)
    num_edges: int

    def __len__(self) -> int:
        return len(self.start)


def sharp_edges(corners: Array, angle: float) -> SharpEdges:
    """Find the edges where the normals of the two faces differ by more than `angle` degrees, and all other edges.

    Parameters
    ----------
    corners : (F, 3, 3) float64 array
        Triangles with an area; corners at the same place are one vertex.
    angle : float
        Degrees. An edge of one face only, or of three or more, is sharp whatever the angle.
    """
    num = len(corners)
    vertex = np.unique(corners.reshape(-1, 3) + 0.0, axis=0, return_inverse=True)[1].reshape(num, 3)
    # Half edge k of a face goes from its corner k to the next.
    face, start, end = np.repeat(np.arange(num), 3), vertex.ravel(), np.roll(vertex, -1, axis=1).ravel()
    low, high = np.minimum(start, end), np.maximum(start, end)
    order = np.lexsort((high, low))
    new = (np.diff(low[order], prepend=-1) != 0) | (np.diff(high[order], prepend=-1) != 0)
    edge = np.empty(3 * num, np.intp)
    edge[order] = np.cumsum(new) - 1
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)

    two = np.flatnonzero(np.bincount(edge) == 2)
    first = np.flatnonzero(new)[two]
    i, j = order[first], order[first + 1]
    against = np.where(start[i] == start[j], -1.0, 1.0)  # both run the same way where one face is wound wrongly
    smooth = against * (normal[face[i]] * normal[face[j]]).sum(axis=1) >= np.cos(np.radians(angle))
    is_sharp = np.ones(int(edge.max()) + 1, bool)
    is_sharp[two[smooth]] = False
    joined = coo_array((np.ones(smooth.sum()), (face[i[smooth]], face[j[smooth]])), shape=(num, num))
    patch_of_face = connected_components(joined, directed=False)[1]

    half = np.flatnonzero(is_sharp[edge])
    of, k = np.divmod(half, 3)
    a, b = corners[of, k], corners[of, (k + 1) % 3]
    inward = np.cross(normal[of], b - a)
    inward /= np.linalg.norm(inward, axis=1, keepdims=True)
    return SharpEdges(a, b, inward, normal[of], patch_of_face[of], patch_of_face, int(is_sharp.sum()))
