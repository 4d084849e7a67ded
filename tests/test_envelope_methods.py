"""Margins and envelopes of every method: the oracle's margins, and no render outside its envelope."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scenes import CAMERAS, EPSILON, SCENES
from test_envelope import BOUNDED, bounds, escapes, rounded_otherwise

import splatcl
import splatcl.io.exr
from splatcl import RenderSettings, Splats, oracle, uncertainty

METHODS = {
    "zwicker04": RenderSettings(method="zwicker04", epsilon=EPSILON, facing="flip"),
    "zwicker01": RenderSettings(method="zwicker01", epsilon=EPSILON, facing="cull", along="ray"),
    "botsch04": RenderSettings(method="botsch04", epsilon=EPSILON, facing="flip"),
    "botsch03": RenderSettings(method="botsch03", epsilon=EPSILON),
    "field": RenderSettings(normals="field", epsilon=0.0),
    "conic": RenderSettings(footprint="conic", prefilter_center="bounds", epsilon=EPSILON),
    "lines": RenderSettings(epsilon=EPSILON, facing="flip"),
}


def furnished(splats, seed, choices):
    """Splats with normal fields where the choices take them, and clip lines on half of the splats where not."""
    rng, num = np.random.default_rng(seed), len(splats)
    if choices.normals == "field":
        return replace(splats, normal_du=rng.normal(size=(num, 3)) * 0.3, normal_dv=rng.normal(size=(num, 3)) * 0.3)
    angle = rng.uniform(0, 2 * np.pi, (num, 2))
    clip = np.stack([np.cos(angle), np.sin(angle), rng.uniform(-0.2, 1, (num, 2))], axis=-1)
    clip[rng.random(num) < 0.5] = 0
    return replace(splats, clip=clip)
