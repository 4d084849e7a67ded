"""Splats from raw data: points, meshes, normal fields, decimation."""
