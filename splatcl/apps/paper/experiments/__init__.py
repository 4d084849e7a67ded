"""Experiments that rerun the papers' claims, one file for each figure."""
