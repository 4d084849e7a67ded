"""Invariants of every method: chunks and bands, the order of splats, and shifts by whole pixels keep the image.

whole/test_golden.py, which has a scene of each method, covers tile sizes, lanes and work-items by pixel.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.bits import NONE, arrays, assert_same_bits
from helpers.scenes import CAMERAS, random_ellipses
from tolerances import PERMUTED

from splatcl import RenderSettings
from splatcl.opencl.passes import bin as bin_pass

EPSILON = 0.25
CHOICES = {  # the golden images compile the same programs
    "zwicker04": RenderSettings(EPSILON, method="zwicker04"),
    "zwicker01": RenderSettings(EPSILON, method="zwicker01", facing="cull"),
    "botsch04": RenderSettings(EPSILON, method="botsch04", facing="flip"),
    "botsch03": RenderSettings(EPSILON, method="botsch03", facing="cull"),
    "clip": RenderSettings(EPSILON),
}
CAMERA = CAMERAS["off_center"]


@pytest.fixture(params=CHOICES)
def case(request):
    """Return splats with the extras that the method reads, and its settings."""
    rng, splats = np.random.default_rng(7), random_ellipses(7)
    fields = dict(zip(("normal_du", "normal_dv"), rng.normal(size=(2, 200, 3)) * 0.3, strict=True))
    lines = {"clip": np.array([0, 0, 0.5]) + rng.normal(size=(200, 2, 3))}
    further = {"botsch04": fields, "clip": lines}.get(request.param, {})
    return replace(splats, **further, on_invalid="error"), CHOICES[request.param]


def test_chunks_and_bands_change_no_bit(renderer, monkeypatch, case):
    splats, chosen = case
    whole, bands = arrays(renderer.render(splats, CAMERA, chosen)), bin_pass.bands
    assert whole["count"].max() > 1
    for chunk, most, band in ((16, 70, 100), (48, 3, 1)):
        monkeypatch.setattr(bin_pass, "MIN_CHUNK", chunk)
        monkeypatch.setattr(bin_pass, "MAX_CHUNKS", most)
        monkeypatch.setattr(bin_pass, "bands", lambda totals, _, band=band: bands(totals, band))
        assert_same_bits(whole, arrays(renderer.render(splats, CAMERA, chosen)))


def test_a_permuted_batch(renderer, case):
    """Coverage and depth keep their bits; the sums are taken in another order."""
    splats, chosen = case
    order = np.random.default_rng(8).permutation(len(splats))
    a, b = (arrays(renderer.render(s, CAMERA, chosen)) for s in (splats, splats.take(order)))
    for exact in ("Z", "count"):
        assert a[exact].tobytes() == b[exact].tobytes()
    hit = a["particleid"] != NONE
    np.testing.assert_array_equal(a["particleid"][hit], order[b["particleid"][hit]])
    np.testing.assert_allclose(a["weight"], b["weight"], rtol=PERMUTED)


def test_a_shifted_principal_point_shifts_the_image(renderer, case):
    """The image moves by whole pixels and keeps every bit, because the camera's numbers are exact."""
    splats, chosen = case
    camera = replace(CAMERA, fx=64.0, fy=64.0, cx=21.25, cy=17.5)
    moved = replace(camera, cx=camera.cx + 5, cy=camera.cy - 3)
    a, b = (arrays(renderer.render(splats, c, chosen)) for c in (camera, moved))
    names = ("Z", "count", "particleid", "weight", "N")
    there = {name: np.ascontiguousarray(b[name][:-3, 5:]) for name in names}
    assert a["count"][3:, :-5].any()
    assert_same_bits({name: a[name] for name in names}, there, np.s_[3:, :-5])
