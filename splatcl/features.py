"""Sharp features: splats that clip lines cut off at edges ([ZRB04]). docs/guide/features.md shows how to make them."""

from splatcl.prepare.features.clip_lines import clip_lines
from splatcl.prepare.features.csg import csg_splats, cube
from splatcl.prepare.features.mesh import mesh_features
from splatcl.prepare.features.solids import Solid, box, cylinder, sphere

__all__ = ["Solid", "box", "clip_lines", "csg_splats", "cube", "cylinder", "mesh_features", "sphere"]
