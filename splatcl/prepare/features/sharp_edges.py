"""Sharp edges of a mesh: edges of two faces at an angle, of one face, or of three and more."""

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
    """The sharp edges of a mesh, each once for every face that it bounds, world space.

    Sharp edges divide a mesh into patches; faces joined by smooth edges are of one patch.
    """

    start: Array  # (E, 3) first ends
    end: Array  # (E, 3) second ends
    inward: Array  # (E, 3) unit vectors in the face's plane, orthogonal to the edge, toward the face
    normal: Array  # (E, 3) unit normals of the faces
    patch: Array  # (E,) patches of the faces
    patch_of_face: Array  # (F,) patch of each face of the mesh
    num_edges: int  # number of distinct sharp edges

    def __len__(self) -> int:
        return len(self.start)


def sharp_edges(corners: Array, angle: float) -> SharpEdges:
    """Find the sharp edges of a mesh.

    Parameters
    ----------
    corners : (F, 3, 3) float64 array
        Triangles with an area, world space; coincident corners are one vertex.
    angle : float
        Degrees. An edge of two faces is sharp if their normals differ by more; all other edges are sharp.
    """
    num = len(corners)
    vertex = np.unique(corners.reshape(-1, 3) + 0.0, axis=0, return_inverse=True)[1].reshape(num, 3)
    # Half edge k of a face goes from its corner k to the next corner.
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
    sign = np.where(start[i] == start[j], -1.0, 1.0)  # half edges in one direction: one face is wound wrongly
    smooth = sign * (normal[face[i]] * normal[face[j]]).sum(axis=1) >= np.cos(np.radians(angle))
    is_sharp = np.ones(int(edge.max()) + 1, bool)
    is_sharp[two[smooth]] = False
    joined = coo_array((np.ones(smooth.sum()), (face[i[smooth]], face[j[smooth]])), shape=(num, num))
    patch_of_face = connected_components(joined, directed=False)[1]

    half = np.flatnonzero(is_sharp[edge])
    bounded, k = np.divmod(half, 3)
    a, b = corners[bounded, k], corners[bounded, (k + 1) % 3]
    inward = np.cross(normal[bounded], b - a)
    inward /= np.linalg.norm(inward, axis=1, keepdims=True)
    return SharpEdges(a, b, inward, normal[bounded], patch_of_face[bounded], patch_of_face, int(is_sharp.sum()))
