"""Geometry of splats and pixels: rays, discs, ellipses, and the fragments where a ray meets a footprint."""
