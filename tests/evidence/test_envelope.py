"""Margins of whole images equal the oracle's, and renders of any rounding stay inside the envelope."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.envelopes import BOUNDED, CHOICES, EVERY, REST, bounds, escapes, rounded_otherwise
from helpers.scenes import CAMERAS, EPSILON, SCENES, random_ellipses
from hypothesis import given, settings
from hypothesis import strategies as st

import splatcl
import splatcl.io.exr
from splatcl import RenderSettings, Splats, oracle
from splatcl.evidence.host import margin as host_margin
from splatcl.evidence.host import pairs
from splatcl.opencl.device import program

TABLES = ("nearest", "linear", "texture", "linear texture")


NONE = dict.fromkeys(BOUNDED, 0)


# ---- the margin


@pytest.mark.parametrize(
    ("scene", "camera", "choices"),
    [*(view for view in EVERY if view[2] not in TABLES), *(r for r in REST if r.values[2] not in TABLES)],
)
def test_the_margin_is_the_oracle_s(scene, camera, choices, monkeypatch):
    """Several bands of rows change nothing. Mutation: no kappa in the slack of _disc_bounds (edge_on)."""
    monkeypatch.setattr(pairs, "PAIRS_PER_BAND", 1 << 12)
    splats, view = SCENES[scene](1), CAMERAS[camera]
    expected = np.minimum(oracle.render(splats, view, CHOICES[choices])["margin"], pairs.MAX_MARGIN)
    margin, raw = host_margin.margin(splats, view, CHOICES[choices], CHOICES[choices].epsilon)
    np.testing.assert_allclose(margin, expected, rtol=1e-4, atol=1e-3)
    assert (np.isinf(raw) == (margin == pairs.MAX_MARGIN)).all()


def test_the_raw_margin_is_the_distance_itself():
    """At each pixel near the rim of a facing disc, margin.raw is |1 - r|."""
    view = splatcl.Camera(np.eye(4), 64, 64, 16, 16, 32, 32)
    radius = np.hypot(0.5, 8.5) / 64 * (1 + 1e-6)
    disc = Splats(np.array([[0, 0, 1.0]]), np.array([[0, radius, 0]]), np.array([[radius, 0, 0]]))
    margin, raw = host_margin.margin(disc, view, RenderSettings(prefilter="none"), 0.1)
    near = margin < 10
    assert np.count_nonzero(near) == 16  # (0.5, 8.5) and (5.5, 6.5) are equally far from the center
    np.testing.assert_allclose(raw[near], 1e-6, rtol=1e-3)


def test_no_splats_have_no_uncertain_pixel():
    empty = np.zeros((0, 3))
    margin, _ = host_margin.margin(Splats(empty, empty, empty), CAMERAS["outside"], RenderSettings(), 0.0)
    assert (margin == pairs.MAX_MARGIN).all()
    limits = bounds(Splats(empty, empty, empty), CAMERAS["outside"], RenderSettings(epsilon=0.0))
    assert np.isinf(limits["Z.lo"]).all() and not limits["weight.hi"].any() and not limits["N.lo"].any()


# ---- the envelope


@pytest.mark.parametrize(("scene", "camera", "choices"), [*EVERY, *REST])
def test_our_renders_are_inside(renderer, scene, camera, choices):
    """Mutation: z_low for z_high in `_choices`, so a front splat that may miss does not change depth(p)."""
    splats, view = SCENES[scene](2), CAMERAS[camera]
    frame = renderer.render(splats, view, CHOICES[choices])
    assert escapes(bounds(splats, view, CHOICES[choices]), frame) == NONE


@settings(max_examples=25, deadline=None, derandomize=True)
@given(
    scene=st.sampled_from(["random_ellipses", "layers", "sphere", "sub_pixel"]),
    camera=st.sampled_from(["outside", "clipped", "off_center"]),
    choices=st.sampled_from(sorted(CHOICES)),
    seed=st.integers(0, 1000),
)
def test_renders_with_other_rounding_are_inside(scene, camera, choices, seed):
    """The oracle renders perturbed inputs in float64, and no value leaves the envelope."""
    splats, view = SCENES[scene](3), CAMERAS[camera]
    other = oracle.render(rounded_otherwise(splats, view, seed), view, CHOICES[choices])
    rounded = {name: np.float32(other[name]) for name in BOUNDED}
    assert escapes(bounds(splats, view, CHOICES[choices]), rounded) == NONE


@pytest.mark.usefixtures("renderer")  # it remembers the arithmetic of careful builds
@pytest.mark.parametrize(
    "flags",
    ["-cl-fast-relaxed-math", pytest.param("-cl-mad-enable -cl-unsafe-math-optimizations", marks=pytest.mark.slow)],
)
@pytest.mark.parametrize("scene", ["random_ellipses", "layers", "sphere", "sub_pixel"])
def test_fast_math_builds_are_inside(scene, flags, monkeypatch):
    """Kernels built with every license to be inexact give other bits, and no value leaves the envelope."""
    import pyopencl as cl

    build = cl.Program.build

    def fast(self, options=None, *args, **kwargs):
        return build(self, [*(options or []), *flags.split()], *args, **kwargs)

    real = program.inline_source
    monkeypatch.setattr(cl.Program, "build", fast)
    monkeypatch.setattr(program, "inline_source", lambda *a: "#pragma OPENCL FP_CONTRACT ON\n" + real(*a))
    splats, view, choices = SCENES[scene](4), CAMERAS["outside"], CHOICES["default"]
    careless = splatcl.Renderer(allow_inexact=True).render(splats, view, choices)
    weights = careless["weight"].copy()
    assert escapes(bounds(splats, view, choices), careless) == NONE
    monkeypatch.undo()
    assert not np.array_equal(weights, splatcl.Renderer().render(splats, view, choices)["weight"])


def test_the_envelope_opens_where_the_front_splat_may_miss():
    """The rim of the front disc is within the tolerance of a pixel, so the back disc may count there or not."""
    view = splatcl.Camera(np.eye(4), 64, 64, 16, 16, 32, 32)
    radius = np.hypot(0.5, 8.5) / 64 * (1 + 1e-7)
    row = np.array([[0, 0, 1.0], [0, 0, 1.5]])
    discs = Splats(
        row,
        np.array([[0, radius, 0], [0, 1.0, 0]]),
        np.array([[radius, 0, 0], [1.0, 0, 0]]),
        color=np.array([[1.0, 0, 0], [0, 0, 1.0]]),
    )
    limits = bounds(discs, view, RenderSettings(epsilon=0.1, prefilter="none"))
    y, x = 16, 24  # (8.5, 0.5) pixels from the middle
    assert limits["Z.lo"][y, x] == pytest.approx(1, abs=1e-4) and limits["Z.hi"][y, x] == pytest.approx(1.5, abs=1e-4)
    np.testing.assert_allclose(limits["albedo.lo"][y, x], [0, 0, 0], atol=1e-5)
    np.testing.assert_allclose(limits["albedo.hi"][y, x], [1, 0, 1], atol=1e-5)
    middle = limits["Z.hi"][16, 16] - limits["Z.lo"][16, 16]
    assert 0 < middle < 1e-4
    np.testing.assert_allclose(limits["albedo.lo"][16, 16], [1, 0, 0], atol=1e-5)


def test_the_envelope_is_tight_where_nothing_is_open():
    splats, view, choices = random_ellipses(5), CAMERAS["outside"], CHOICES["default"]
    limits = bounds(splats, view, choices)
    margin, _ = host_margin.margin(splats, view, choices, EPSILON)
    covered = (limits["weight.lo"] > 0) & (margin == pairs.MAX_MARGIN)
    assert np.count_nonzero(covered) > 500
    for name in ("albedo", "N"):
        width = (limits[f"{name}.hi"] - limits[f"{name}.lo"])[covered].max(axis=-1)
        assert np.median(width) < 1e-4
    hit = covered & np.isfinite(limits["Z.hi"])
    assert np.median(limits["Z.hi"][hit] / limits["Z.lo"][hit] - 1) < 5e-4


def test_a_larger_tolerance_holds_a_smaller_one():
    splats, view, choices = random_ellipses(6), CAMERAS["outside"], CHOICES["default"]
    inner, outer = bounds(splats, view, choices, tolerance=8.0), bounds(splats, view, choices, tolerance=64.0)
    for name in BOUNDED:
        assert (outer[f"{name}.lo"] <= inner[f"{name}.lo"]).all()
        assert (outer[f"{name}.hi"] >= inner[f"{name}.hi"]).all()


def test_double_precision_is_inside():
    splats, view = random_ellipses(7), CAMERAS["outside"]
    choices = replace(CHOICES["default"], precision="double")
    frame = splatcl.render(splats, view, choices)
    assert escapes(bounds(splats, view, choices), frame) == NONE


# ---- frames, files and the command line


def test_a_frame_adds_them_on_request(renderer, tmp_path):
    frame = renderer.render(random_ellipses(8), CAMERAS["outside"], CHOICES["default"])
    assert "margin" not in frame and frame["margin"].shape == frame["Z"].shape
    frame.add_envelope(16.0)
    frame.save(tmp_path / "frame.exr")
    aovs, _, metadata = splatcl.io.exr.read_exr(tmp_path / "frame.exr")
    for name in ("margin", "margin.raw", "Z.lo", "weight.hi", "albedo.lo", "N.hi"):
        np.testing.assert_array_equal(aovs[name], frame[name])
    assert metadata["envelope_tolerance"] == 16.0
    assert escapes(aovs, aovs) == NONE


@pytest.mark.parametrize("tolerance", [0.0, -1.0, 1e4, float("nan")])
def test_a_tolerance_out_of_range_is_refused(renderer, tolerance):
    frame = renderer.render(random_ellipses(8), CAMERAS["outside"], CHOICES["default"])
    with pytest.raises(splatcl.SplatclError, match="tolerance"):
        frame.add_envelope(tolerance)


def test_a_frame_without_splats_says_so(renderer):
    import pickle

    frame = pickle.loads(pickle.dumps(renderer.render(random_ellipses(8), CAMERAS["outside"])))
    with pytest.raises(splatcl.SplatclError, match="cannot add a margin to a frame without its splats"):
        frame["margin"]


def test_the_command_line_writes_them(tmp_path):
    from splatcl.cli import main

    splatcl.write(random_ellipses(9), tmp_path / "scan.npz")
    out = tmp_path / "out.exr"
    assert (
        main(["render", str(tmp_path / "scan.npz"), "-o", str(out), "--size", "40x30", "--margin", "--envelope"]) == 0
    )
    aovs = splatcl.io.exr.read_exr(out)[0]
    assert aovs["margin"].shape == (30, 40) and aovs["N.lo"].shape == (30, 40, 3)
    assert main(["render", str(tmp_path / "scan.npz"), "--png", str(tmp_path / "o.png"), "--margin"]) == 2
