"""Margins and envelopes of every method: margins equal the oracle's, and no render leaves its envelope."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.envelopes import BOUNDED, bounds, escapes, rounded_otherwise
from helpers.scenes import CAMERAS, EPSILON, SCENES
from tolerances import DEVICE_MARGIN, DEVICE_RELATIVE

import splatcl
import splatcl.io.exr
from splatcl import RenderSettings, Splats, oracle
from splatcl.evidence.host import margin as host_margin
from splatcl.evidence.host import pairs

METHODS = {
    "zwicker04": RenderSettings(method="zwicker04", epsilon=EPSILON, facing="flip"),
    "zwicker01": RenderSettings(method="zwicker01", epsilon=EPSILON, facing="cull", along="ray"),
    "botsch04": RenderSettings(method="botsch04", epsilon=EPSILON, facing="flip"),
    "botsch03": RenderSettings(method="botsch03", epsilon=EPSILON),
    "field": RenderSettings(normals="field", epsilon=0.0),
    "conic": RenderSettings(footprint="conic", prefilter_center="bounds", epsilon=EPSILON),
    "conic plane": RenderSettings(footprint="conic", filter_depth="plane", epsilon=EPSILON),
    "affine front": RenderSettings(footprint="affine", prefilter="min", filter_depth="front", epsilon=EPSILON),
    "point": RenderSettings(sprite="point", epsilon=EPSILON, facing="flip"),
    "lines": RenderSettings(epsilon=EPSILON, facing="flip"),
}


def furnished(splats, seed, choices):
    """Return the splats with normal fields if the choices take them, else with clip lines on half of the splats."""
    rng, num = np.random.default_rng(seed), len(splats)
    if choices.normals == "field":
        return replace(splats, normal_du=rng.normal(size=(num, 3)) * 0.3, normal_dv=rng.normal(size=(num, 3)) * 0.3)
    angle = rng.uniform(0, 2 * np.pi, (num, 2))
    clip = np.stack([np.cos(angle), np.sin(angle), rng.uniform(-0.2, 1, (num, 2))], axis=-1)
    clip[rng.random(num) < 0.5] = 0
    return replace(splats, clip=clip)


def scene(name, seed, choices, lines=True):
    """Return a hundred splats, with normal fields if the choices take them, else with clip lines if `lines`."""
    splats = SCENES[name](seed).take(slice(0, 100))
    return furnished(splats, seed, choices) if lines or choices.normals == "field" else splats


def escaped(limits, aovs):
    """Count the values outside the envelope."""
    return sum(escapes(limits, {name: np.float32(aovs[name]) for name in BOUNDED if name in aovs}).values())


# ---- the margin


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    ("name", "camera", "most"),
    [("edge_on", "outside", 128.0), ("giant", "close", 128.0), ("random_ellipses", "close", 2.0**13)],
)
def test_the_margin_is_the_oracle_s(method, name, camera, most, monkeypatch):
    """Margins count up to `most` units, because ordinary scenes have few near ties.

    Mutations: no kappa in the slack of _ellipse_bounds (edge_on); the disc's margin where nothing covers the pixel; the
    filtered ellipse's margin in the visibility pass.
    """
    monkeypatch.setattr(pairs, "MAX_MARGIN", most)
    monkeypatch.setattr(host_margin, "MAX_MARGIN", most)
    choices, view = METHODS[method], CAMERAS[camera]
    splats = scene(name, 1, choices)
    expected = np.minimum(oracle.render(splats, view, choices)["margin"], pairs.MAX_MARGIN)
    margin, raw = host_margin.margin(splats, view, choices, choices.epsilon)
    np.testing.assert_allclose(margin, expected, rtol=1e-4, atol=1e-3)
    assert (np.isinf(raw) == (margin == pairs.MAX_MARGIN)).all()
    assert (margin < most).any()


@pytest.mark.parametrize("prefilter", ["ewa", "none"])
@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_the_margin_of_a_facing_ellipse(prefilter, projection):
    """A circle of 8 pixels passes a pixel 8 (1 + 1e-6) away; its filtered radius is sqrt(8^2 + 2^2)."""
    view = splatcl.Camera(np.eye(4), 32, 32, 16.5, 16.5, 33, 33, near=0.1, projection=projection)
    radius = np.hypot(8, 2 if prefilter == "ewa" else 0) / (1 + 1e-6)
    drawn = np.sqrt(radius**2 - (4 if prefilter == "ewa" else 0)) / 32
    disc = Splats(np.array([[0, 0, 1.0]]), np.array([[0, drawn, 0]]), np.array([[drawn, 0, 0]]))
    choices = RenderSettings(footprint="affine", prefilter=prefilter)
    margin, raw = host_margin.margin(disc, view, choices, 0.1)
    off = np.hypot(*(np.mgrid[:33, :33] - 16))
    near = np.isclose(off, np.hypot(8, 2) if prefilter == "ewa" else 8)
    assert near.any() and (margin[near] < pairs.MAX_MARGIN).all()
    np.testing.assert_allclose(raw[near], 1e-6, rtol=1e-3)
    assert np.isinf(raw[(off > 9) | (off < 7)]).all()


# ---- the envelope


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    ("name", "camera"), [("random_ellipses", "clipped"), ("layers", "off_center"), ("thin", "orthographic")]
)
def test_renders_with_other_rounding_are_inside(method, name, camera):
    """The oracle renders perturbed inputs in float64, and no value leaves the envelope.

    Mutations: hits of ellipses without the center's depth; bounds of a normal field without the errors of u and v, or
    without the center's normal.
    """
    choices, view = METHODS[method], CAMERAS[camera]
    splats = scene(name, 2, choices, lines=method in ("lines", "zwicker01"))
    moved = rounded_otherwise(splats, view, 5)
    moved = replace(splats, center=moved.center, tangent_u=moved.tangent_u, tangent_v=moved.tangent_v)
    limits = bounds(splats, view, choices)
    assert ("albedo.lo" in limits) == (choices.shading == "deferred")
    assert escaped(limits, oracle.render(moved, view, choices)) == 0


@pytest.mark.parametrize("method", ["zwicker04", "zwicker01", "botsch04", "botsch03"])
def test_a_frame_of_any_method_adds_both(renderer, method, tmp_path):
    choices, view = METHODS[method], CAMERAS["outside"]
    frame = renderer.render(scene("edge_on", 3, choices), view, choices)
    frame.add_envelope()
    assert frame["margin"].min() < pairs.MAX_MARGIN
    frame.save(tmp_path / "frame.exr")
    aovs = splatcl.io.exr.read_exr(tmp_path / "frame.exr")[0]
    assert escaped(aovs, aovs) == 0 and (aovs["weight.lo"] > 0).any()


def test_circles_and_halves_are_bounded_as_they_are_drawn(renderer):
    """The frame keeps splats that are already rounded and circular; a second rounding would move them."""
    choices = replace(METHODS["botsch03"], half_inputs=True)
    splats = scene("random_ellipses", 4, choices)
    frame = renderer.render(splats, CAMERAS["outside"], choices)
    as_drawn = splats.half_precision().circular()
    margin, _ = host_margin.margin(as_drawn, CAMERAS["outside"], replace(choices, circular=False), EPSILON)
    np.testing.assert_array_equal(frame["margin"], margin)
    frame.add_envelope(8.0)
    assert escaped(frame, frame) == 0


def test_a_coarse_target_has_margins_but_no_envelope(renderer):
    choices, view = RenderSettings(target="float16", epsilon=EPSILON), CAMERAS["outside"]
    splats = scene("edge_on", 5, choices, lines=False)
    frame = renderer.render(splats, view, choices)
    margin, _ = host_margin.margin(splats, view, replace(choices, target="auto"), EPSILON)
    np.testing.assert_allclose(frame["margin"], margin, atol=DEVICE_MARGIN, rtol=DEVICE_RELATIVE)
    with pytest.raises(splatcl.SplatclError, match=r"target='float16' has no envelope: .* choose target='float32'"):
        frame.add_envelope()
    with pytest.raises(splatcl.SplatclError, match="target='unorm8' has no envelope"):
        bounds(splats, view, replace(choices, target="unorm8"))


def test_a_narrow_target_under_double_is_inside(renderer):
    """Sums rounded to float32 stay inside an envelope with a tolerance of one unit."""
    choices = RenderSettings(precision="double", target="float32", epsilon=EPSILON)
    splats = scene("layers", 6, choices, lines=False)
    frame = renderer.render(splats, CAMERAS["outside"], choices)
    frame.add_envelope(1.0)
    assert escaped(frame, frame) == 0


def test_the_command_line_writes_them_for_a_method(tmp_path):
    from splatcl.cli import main

    splatcl.write(SCENES["random_ellipses"](9).take(slice(0, 50)), tmp_path / "scan.npz")
    out = tmp_path / "out.exr"
    arguments = ["--method", "botsch03", "--size", "40x30", "--margin", "--envelope"]
    assert main(["render", str(tmp_path / "scan.npz"), "-o", str(out), *arguments]) == 0
    aovs = splatcl.io.exr.read_exr(out)[0]
    assert aovs["margin"].shape == (30, 40) and aovs["N.lo"].shape == (30, 40, 3) and "albedo.lo" not in aovs
