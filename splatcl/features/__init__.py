"""Sharp features: splats that clip lines cut off at edges ([ZRB04]). docs/guide/features.md shows how to make them."""

from splatcl.features.csg import csg_splats, cube
from splatcl.features.lines import clip_lines
from splatcl.features.mesh import mesh_features
from splatcl.features.solids import Solid, box, cylinder, sphere

__all__ = ["Solid", "box", "clip_lines", "csg_splats", "cube", "cylinder", "mesh_features", "sphere"]
