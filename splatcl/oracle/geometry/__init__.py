"""Geometry of splats and pixels: rays, discs, ellipses and the fragments they make."""
