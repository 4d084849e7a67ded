"""Helpers that know nothing about splats."""
