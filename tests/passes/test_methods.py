"""Every method, footprint, pre-filter, normal field, clip line, stage of shading and target against the oracle."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.feature_rays import slabs
from helpers.scenes import CAMERAS, SCENES, extended
from tolerances import (
    COLOR_LIT,
    DOUBLE_METHODS,
    DOUBLE_UNITS,
    MARGIN_UNITS,
    MASKED_METHODS,
    RESOLVED,
    SINGLE_METHODS,
    TARGET_STEPS,
    WEIGHT_ADVERSARIAL,
    WEIGHT_RELATIVE,
)

from splatcl import Camera, Material, RenderSettings, SplatclError, oracle
from splatcl.evidence.golden.scenes import LIGHTS
from splatcl.features import cube
from splatcl.opencl.state.upload import PHONG_ATTRIBUTES as PHONG

VECTORS = ("N", "albedo", "color", "depth.mean", "P")
LIT = {"lights": LIGHTS, "material": Material(0.1, 0.6, 0.4, 12.0)}
CULL = {"facing": "cull"}  # one layer alone halves the programs to build
ATTRIBUTES = (*PHONG, "rough", "a", "b", "c", "d", "e")


def compare(renderer, splats, camera, settings, masked=MASKED_METHODS):
    """Assert that a render agrees with the oracle where no decision is nearly a tie; return both and those pixels."""
    settings = replace(settings, epsilon=0.1)
    frame, want = renderer.render(splats, camera, settings), oracle.passes(splats, camera, settings, 0.1)
    double = settings.precision == "double"
    units = DOUBLE_UNITS if double else MARGIN_UNITS
    sure, covered = want["margin"] >= units, (want["weight"] > 0) | (frame["weight"] > 0)
    assert np.count_nonzero(~sure & covered) <= max(1, masked * np.count_nonzero(covered))
    np.testing.assert_array_equal(frame["count"][sure], want["count"][sure])
    front = sure & (want["id_margin"] >= units)
    np.testing.assert_array_equal(frame["particleid"][front], want["particleid"][front])
    if settings.target in ("float16", "unorm8"):
        return frame, want, sure & covered
    hit = sure & np.isfinite(want["Z"])
    solid = sure & (want["weight"] > 1e-3 * want["weight"].max())  # EWA gives thin splats almost no weight
    tolerance = DOUBLE_METHODS if double else SINGLE_METHODS
    np.testing.assert_allclose(frame["Z"][hit], want["Z"][hit], rtol=tolerance)
    about_the_eye = masked != MASKED_METHODS  # u and v err more there, so weights and fields do too
    weight_tolerance = DOUBLE_METHODS if double else WEIGHT_ADVERSARIAL if about_the_eye else WEIGHT_RELATIVE
    np.testing.assert_allclose(frame["weight"][solid], want["weight"][solid], rtol=weight_tolerance)
    lit = settings.shading != "deferred"
    for name in [n for n in (*VECTORS, *(n for n in want if n.startswith("attribute."))) if n in frame]:
        scale = max(1.0, float(np.abs(want[name][solid]).max(initial=0.0)))
        lit_tolerance = WEIGHT_ADVERSARIAL if about_the_eye else COLOR_LIT
        allowed = scale * (DOUBLE_METHODS if double else lit_tolerance if lit or name == "color" else RESOLVED)
        np.testing.assert_allclose(frame[name][solid], want[name][solid], rtol=0, atol=allowed, err_msg=name)
    return frame, want, sure & covered


@pytest.mark.parametrize(
    ("method", "facing"),
    [
        ("zwicker04", "keep"),
        ("zwicker01", "cull"),
        ("botsch04", "keep"),
        ("botsch03", "cull"),
        pytest.param("zwicker01", "keep", marks=pytest.mark.slow),
        pytest.param("botsch03", "keep", marks=pytest.mark.slow),
    ],
)
def test_methods_against_the_oracle(renderer, method, facing):
    """The scenes show discs of all sizes, from outside and across the near plane, and clip lines.

    Mutations: an ellipse about the projected center instead of its own; EWA without its factor; a field that is not
    turned with its normal; circles of the shorter axis.
    """
    settings = RenderSettings(method=method, facing=facing)
    field = method == "botsch04"
    for scene, camera in (
        ("random_ellipses", "outside"),
        ("random_ellipses", "inside"),
        ("layers", "outside"),
        ("sphere", "outside"),
        ("near_plane", "close"),
        ("sub_pixel", "outside"),
        ("giant", "outside"),
    ):
        masked = 0.05 if scene in ("near_plane", "giant") else MASKED_METHODS
        compare(renderer, extended(scene, 2, field=field), CAMERAS[camera], settings, masked)
    compare(renderer, extended("random_ellipses", 2, True, field), CAMERAS["outside"], settings)


@pytest.mark.parametrize("method", [pytest.param("zwicker04", marks=pytest.mark.slow), "botsch04"])
def test_methods_in_double_precision(renderer, method):
    if not renderer.supports_double:
        pytest.skip("this device has no double precision")
    settings = RenderSettings(method=method, precision="double", **CULL)
    compare(renderer, extended("random_ellipses", 4, True, method == "botsch04"), CAMERAS["outside"], settings)


@pytest.mark.parametrize("method", ["zwicker04", "zwicker01", "botsch04"])
def test_methods_without_perspective(renderer, method):
    settings = RenderSettings(method=method, **CULL)
    splats = extended("random_ellipses", 5, field=method == "botsch04")
    compare(renderer, splats, CAMERAS["orthographic"], settings)


@pytest.mark.parametrize(
    "settings",
    [
        pytest.param(RenderSettings(footprint="affine", prefilter="min", **CULL), marks=pytest.mark.slow),
        RenderSettings(footprint="conic", prefilter="min", prefilter_center="bounds", prefilter_radius=3.0, **CULL),
        RenderSettings(footprint="conic", prefilter="none", along="ray", facing="cull"),
        RenderSettings(method="zwicker04", cutoff=3.0, prefilter_radius=2.0),
        RenderSettings(normals="field", kernel="constant", **LIT, **CULL),
    ],
    ids=["affine min", "conic min", "conic none", "wide ewa", "field deferred"],
)
def test_settings_compose(renderer, settings):
    compare(renderer, extended("random_ellipses", 3, True, True), CAMERAS["outside"], settings)


@pytest.mark.parametrize(
    "method, attributes",
    [
        ("botsch05", ATTRIBUTES),
        ("botsch05", ("shininess", "x")),
        ("botsch04", PHONG),
        ("botsch03", ("specular",)),
    ],
)
def test_attributes_blend_like_colors_and_feed_the_shader(renderer, method, attributes):
    """Mutations: specular read where only shininess is given; channels shifted by the gloss."""
    splats = extended("random_ellipses", 6, field=True, attributes=attributes)
    frame, *_ = compare(renderer, splats, CAMERAS["outside"], RenderSettings(method=method, **LIT, **CULL))
    assert [name for name in frame if name.startswith("attribute.")] == [f"attribute.{n}" for n in _ordered(attributes)]


def _ordered(names):
    return [*(n for n in PHONG if n in names), *(n for n in names if n not in PHONG)]


@pytest.mark.parametrize("target", ["float16", "unorm8"])
@pytest.mark.parametrize("method", ["botsch05", "botsch04"])
def test_targets_round_every_step(renderer, target, method):
    """Sums are steps of the format. They equal the oracle's unless a weight lies on the border of two steps."""
    splats = extended("layers", 7, field=True)
    frame, want, sure = compare(
        renderer, splats, CAMERAS["outside"], RenderSettings(method=method, target=target, **CULL)
    )
    weight = frame["weight"].astype(np.float64)
    steps = weight * 255 if target == "unorm8" else weight.astype(np.float16)
    rounded = np.round(steps) / 255 if target == "unorm8" else steps.astype(np.float64)
    np.testing.assert_allclose(weight, rounded, rtol=1e-7)
    assert np.count_nonzero(frame["weight"][sure] != want["weight"][sure].astype(np.float32)) <= sure.sum() / 100
    np.testing.assert_allclose(frame["weight"][sure], want["weight"][sure], atol=TARGET_STEPS[target])
    assert (weight.max() == 1.0) if target == "unorm8" else (weight.max() > 1.0)


@pytest.mark.parametrize("target", ["float16", "unorm8"])
def test_targets_are_exact_where_nothing_is_rounded_before(renderer, target):
    """Weights of 1 and dyadic colors leave only the format's own rounding of the sums, so weights are exact."""
    splats = extended("layers", 8)
    splats = replace(splats, color=np.round(splats.color * 16) / 16)
    settings = RenderSettings(target=target, kernel="constant", shader="albedo")
    frame, want, sure = compare(renderer, splats, CAMERAS["outside"], settings)
    np.testing.assert_array_equal(frame["weight"][sure], want["weight"][sure].astype(np.float32))
    color = (want["albedo"] * want["weight"][..., None])[sure]
    found = (frame["albedo"] * frame["weight"][..., None])[sure]
    np.testing.assert_allclose(found, color, atol=1e-6)


@pytest.mark.parametrize("view", [(2.2, 1.7, 2.9), (1.9, -2.4, 1.2), (-3.0, 0.6, 1.1)])
def test_clipped_cube_has_no_hole(renderer, view):
    """24 splats with clip lines cover the cube's pixels exactly, and no two overlap at an edge."""
    camera = Camera.look_at(view, (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 40.0, 90, 80)
    splats = cube()
    low, high = splats.center.min(axis=0), splats.center.max(axis=0)
    enter, leave = slabs(camera, low, high)
    enter, leave = enter.max(axis=-1), leave.min(axis=-1)
    near = np.abs(leave - enter) < 1e-4  # the silhouette
    for settings in (RenderSettings(0.01, prefilter="none"), RenderSettings(0.01, footprint="conic", prefilter="none")):
        frame = renderer.render(splats, camera, replace(settings, facing="cull", shader="normal"))
        np.testing.assert_array_equal((frame["count"] > 0)[~near], (leave > enter)[~near])
        face = np.abs(frame["N"] @ camera.eye_from_world[:3, :3])
        crossed = (frame["count"] > 0) & (face.max(axis=-1) < 1 - 1e-5)  # the normals of two faces are blended
        assert np.count_nonzero(crossed) <= 2


def test_meaningless_settings_are_refused(renderer):
    for choices, words in (
        ({"prefilter": "ewa"}, "footprint='affine'"),
        ({"method": "zwicker04", "kernel": "constant"}, "gaussian"),
        ({"method": "botsch04", "shader": "npr"}, "deferred"),
        ({"method": "botsch03", "normals": "field"}, "no effect"),
        ({"target": "float64"}, "double"),
        ({"user_shader": "float4 shade;"}, "user_shader"),
        ({"method": "nobody"}, "must be one of"),
        ({"supersampling": 1.5}, "whole number"),
    ):
        with pytest.raises(SplatclError, match=words):
            RenderSettings(**choices)
    with pytest.raises(SplatclError, match="normal field"):
        renderer.render(SCENES["sphere"](0), CAMERAS["outside"], RenderSettings(method="botsch04"))


def test_half_inputs_are_sixteen_bits(renderer):
    splats = SCENES["sphere"](0)
    half = splats.half_precision()
    assert 0 < np.abs(half.center - splats.center).max() < 2.0**-11 * np.abs(splats.center).max() * 1.1
    unit = half.normal.astype(np.float16).astype(np.float64)
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    np.testing.assert_allclose(unit, half.normal, atol=2.0**-10)
    np.testing.assert_allclose(half.radius, splats.radius, rtol=1e-6)
    camera = CAMERAS["outside"]
    frame = renderer.render(splats, camera, RenderSettings(0.1, half_inputs=True))
    np.testing.assert_array_equal(frame["Z"], renderer.render(half, camera, RenderSettings(0.1))["Z"])


def test_circles_are_the_oracles(renderer):
    splats = SCENES["random_ellipses"](0)
    circles = splats.circular()
    np.testing.assert_allclose(np.linalg.norm(circles.tangent_v, axis=1), splats.radius, rtol=1e-6)
    np.testing.assert_allclose((circles.normal * splats.normal).sum(axis=1), 1, rtol=1e-6)
    frame = renderer.render(splats, CAMERAS["outside"], RenderSettings(0.1, circular=True, prefilter="none"))
    plain = renderer.render(circles, CAMERAS["outside"], RenderSettings(0.1, prefilter="none"))
    np.testing.assert_array_equal(frame["weight"], plain["weight"])


def test_probe_and_check_follow_the_method(renderer):
    """The probe's running sums end at the frame's bits, and the accounting of every method adds up."""
    for method, field in (("zwicker04", False), ("botsch04", True)):
        splats = extended("random_ellipses", 11, True, field)
        frame = renderer.render(splats, CAMERAS["outside"], RenderSettings(0.1, method=method))
        rows, columns = np.nonzero(frame["count"])
        x, y = int(columns[len(columns) // 2]), int(rows[len(rows) // 2])
        probe = frame.probe(x, y)
        last = probe.rows[-1].sums
        assert (last.weight, last.count) == (frame["weight"][y, x].item(), frame["count"][y, x].item())
        assert (probe.depth, probe.particleid) == (frame["Z"][y, x].item(), frame["particleid"][y, x].item())
        assert all(one.passed for one in frame.check())
