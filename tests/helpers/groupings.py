"""The settings and groupings of work for which each kernel is compiled."""

from __future__ import annotations

import pytest

SETTINGS = {
    "no pre-filter, culled": {"prefilter": "none", "facing": "cull"},
    "wide pre-filter about the bounds": {"prefilter_radius": 2.5, "prefilter_center": "bounds"},
    "along the ray, flipped": {"along": "ray", "facing": "flip", "epsilon": 0.25},
    "table": {"kernel": "table", "kernel_table": (1.0, 0.9, 0.4, 0.15, 0.1), "kernel_lookup": "linear"},
    "texture": {"kernel": "table", "kernel_table": (1, 0.9, 0.4), "table_addressing": "texture", "table_over": "r2"},
    "strict": {"epsilon_test": "strict", "along": "ray"},
    "plane": {"filter_depth": "plane", "prefilter_radius": 2.0},
    "front": {"filter_depth": "front", "prefilter_radius": 2.0},
    "auto": {"epsilon": "auto", "cutoff": 0.5},
}


def every_setting_and_grouping():
    """Return all settings in the usual grouping, one in each other grouping, and the rest marked as slow."""
    quick = {(1, 8): "no pre-filter, culled", (4, 32): "table"}
    return [
        pytest.param(settings, *grouping, marks=[] if quick.get(grouping, settings) == settings else pytest.mark.slow)
        for grouping in ((8, 16), *quick)
        for settings in SETTINGS
    ]
