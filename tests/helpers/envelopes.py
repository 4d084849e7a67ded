"""Settings, bounds and counts of values outside them, for the tests of envelopes."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.scenes import EPSILON, VIEWS

from splatcl import RenderSettings, Splats
from splatcl.evidence.host import envelope

CHOICES = {
    "default": RenderSettings(epsilon=EPSILON),
    "culled": RenderSettings(epsilon=EPSILON, prefilter="none", facing="cull", along="ray"),
    "first": RenderSettings(epsilon=0.0, prefilter_center="bounds", facing="flip"),
    "nearest": RenderSettings(epsilon=EPSILON, kernel="table", kernel_table=(1.0, 0.8, 0.9, 0.1)),
    "linear": RenderSettings(
        epsilon=EPSILON, kernel="table", kernel_table=(1.0, 0.2, 0.9), kernel_lookup="linear", facing="flip"
    ),
    "strict": RenderSettings(epsilon=EPSILON, epsilon_test="strict", along="ray"),
    "strict zero": RenderSettings(epsilon=0.0, epsilon_test="strict", facing="flip"),
    "vanishing": RenderSettings(epsilon=1e-7, epsilon_test="strict", prefilter="none"),
    "plane": RenderSettings(epsilon=EPSILON, filter_depth="plane", prefilter_radius=2.0),
    "front": RenderSettings(epsilon=EPSILON, filter_depth="front", epsilon_test="strict"),
    "texture": RenderSettings(
        epsilon=EPSILON, kernel="table", kernel_table=(1.0, 0.8, 0.9, 0.1), table_addressing="texture", table_over="r2"
    ),
    "linear texture": RenderSettings(
        epsilon=EPSILON,
        kernel="table",
        kernel_table=(1.0, 0.2, 0.9),
        kernel_lookup="linear",
        table_addressing="texture",
    ),
}


NEW = ("texture", "strict", "plane", "linear texture", "strict zero", "front", "vanishing")
EVERY = [
    (*view, choices)
    for i, view in enumerate(VIEWS)
    for choices in ("default", ("culled", "first", "nearest", "linear")[i % 4], *NEW[i : i + 1])
]
"""Every scene under every camera with the default settings and with one other; each of `NEW` under one view."""
REST = [pytest.param(*view, NEW[i % len(NEW)], marks=pytest.mark.slow) for i, view in enumerate(VIEWS[len(NEW) :])]
"""Further views of `NEW`, for the slow tests."""


BOUNDED = ("Z", "weight", "albedo", "N")


def bounds(splats, camera, choices, **kwargs):
    return envelope.envelope(splats, camera, choices, choices.epsilon, **kwargs)


def escapes(limits, frame):
    """Count the values of each bounded AOV outside the envelope; NaN counts as outside."""
    return {
        name: int(np.count_nonzero(~((frame[name] >= limits[f"{name}.lo"]) & (frame[name] <= limits[f"{name}.hi"]))))
        for name in BOUNDED
        if f"{name}.lo" in limits
    }


def rounded_otherwise(splats, view, seed):
    """Return the splats with noise on every number, as large as a float32 renderer's rounding toward eye space."""
    rng = np.random.default_rng(seed)
    distance = np.linalg.norm(splats.center - view.position, axis=1, keepdims=True)

    def noise(values, size):
        return values.astype(np.float64) + size * 2.0**-24 * rng.uniform(-1, 1, values.shape)

    lengths = [np.linalg.norm(t, axis=1, keepdims=True) for t in (splats.tangent_u, splats.tangent_v)]
    return Splats(
        noise(splats.center, 2 * distance),
        noise(splats.tangent_u, 2 * lengths[0]),
        noise(splats.tangent_v, 2 * lengths[1]),
        splats.color,
    )
