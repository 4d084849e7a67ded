"""Sharp features: splats that end at edges, cut off by clip lines ([ZRB04]; docs/guide/features.md)."""

from splatcl.prepare.features.clip_lines import clip_lines
from splatcl.prepare.features.csg import csg_splats, cube
from splatcl.prepare.features.mesh import mesh_features
from splatcl.prepare.features.solids import Solid, box, cylinder, sphere

__all__ = ["Solid", "box", "clip_lines", "csg_splats", "cube", "cylinder", "mesh_features", "sphere"]
