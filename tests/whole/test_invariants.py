"""Invariants of any scene: changes that keep the image, or change it in a known way."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.bits import NONE, arrays, assert_same_bits
from helpers.scenes import CAMERAS, SCENES, frames, joined, random_ellipses
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from tolerances import DEPTH_RELATIVE, MARGIN_UNITS, PERMUTED, RESOLVED

from splatcl import Camera, RenderSettings, Splats, oracle
from splatcl.opencl.passes import bin as bin_pass

bounded = settings(
    max_examples=30, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
seeds = st.integers(0, 2**16)
scene_names = st.sampled_from(sorted(SCENES))
cameras = st.sampled_from([CAMERAS[name] for name in sorted(CAMERAS)])
choices = st.builds(
    RenderSettings,
    epsilon=st.sampled_from([0.0, 0.03125, 0.25]),
    along=st.sampled_from(["z", "ray"]),
    prefilter=st.sampled_from(["min", "none"]),
    prefilter_center=st.sampled_from(["projected", "bounds"]),
    facing=st.sampled_from(["keep", "flip", "cull"]),
)


def assert_groupings_change_no_bit(renderer_with, groupings, name, seed, camera, chosen):
    splats = SCENES[name](seed)
    whole = arrays(renderer_with(8, 16).render(splats, camera, chosen))
    for lanes, tile_size in groupings:
        assert_same_bits(whole, arrays(renderer_with(lanes, tile_size).render(splats, camera, chosen)))


@settings(bounded, max_examples=12)
@given(scene_names, seeds, st.sampled_from([CAMERAS["close"], CAMERAS["off_center"]]), choices)
def test_two_groupings_change_no_bit(renderer_with, name, seed, camera, chosen):
    """The settings share their programs."""
    chosen = replace(chosen, prefilter="min", facing="flip")
    assert_groupings_change_no_bit(renderer_with, [(1, 16), (4, 32)], name, seed, camera, chosen)


@pytest.mark.slow
@settings(bounded, max_examples=12)
@given(scene_names, seeds, cameras, choices)
def test_tiles_and_lanes_change_no_bit(renderer_with, name, seed, camera, chosen):
    groupings = [(1, 16), (4, 16), (8, 8), (8, 32), (8, 64), (4, 64), (1, 8)]
    assert_groupings_change_no_bit(renderer_with, groupings, name, seed, camera, chosen)


@bounded
@given(scene_names, seeds, cameras, choices, st.integers(1, 400), st.integers(1, 70), st.integers(1, 3000))
def test_chunks_and_bands_change_no_bit(renderer, name, seed, camera, chosen, chunk, max_chunks, band):
    splats, whole_bands = SCENES[name](seed), bin_pass.bands
    whole = arrays(renderer.render(splats, camera, chosen))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(bin_pass, "MIN_CHUNK", chunk)
        patch.setattr(bin_pass, "MAX_CHUNKS", max_chunks)
        patch.setattr(bin_pass, "bands", lambda totals, _: whole_bands(totals, band))
        assert_same_bits(whole, arrays(renderer.render(splats, camera, chosen)))


@bounded
@given(scene_names, seeds, cameras, choices)
def test_two_runs_are_the_same(renderer, renderer_with, name, seed, camera, chosen):
    splats = SCENES[name](seed)
    first = arrays(renderer.render(splats, camera, chosen))
    resident = renderer.upload(splats)
    renderer.render(random_ellipses(seed), CAMERAS["outside"])  # leaves its records in the scratch buffers
    for again in (resident, resident, splats):
        assert_same_bits(first, arrays(renderer.render(again, camera, chosen)))


@bounded
@given(scene_names, seeds, cameras, choices, st.randoms(use_true_random=False))
def test_a_permuted_batch(renderer, name, seed, camera, chosen, random):
    """Coverage and depth keep their bits; the sums are taken in another order."""
    splats = SCENES[name](seed)
    order = list(range(len(splats)))
    random.shuffle(order)
    a, b = (arrays(renderer.render(s, camera, chosen)) for s in (splats, splats.take(order)))
    for exact in ("Z", "count"):
        assert a[exact].tobytes() == b[exact].tobytes()
    hit = a["particleid"] != NONE
    np.testing.assert_array_equal(hit, b["particleid"] != NONE)
    # No two splats have exactly the same depth, where the lower index would be in front.
    np.testing.assert_array_equal(a["particleid"][hit], np.array(order)[b["particleid"][hit]])
    np.testing.assert_allclose(a["weight"], b["weight"], rtol=PERMUTED)
    np.testing.assert_allclose(a["albedo"], b["albedo"], rtol=PERMUTED)


@bounded
@given(scene_names, seeds, cameras, choices, st.integers(0, 200))
def test_a_split_batch(renderer, name, seed, camera, chosen, cut):
    """The depth of the whole is the lesser depth of the parts, bit for bit, and so is its front splat."""
    splats = SCENES[name](seed)
    parts = splats.take(slice(0, cut)), splats.take(slice(cut, None))
    whole, first, second = (arrays(renderer.render(s, camera, chosen)) for s in (splats, *parts))
    nearer = first["Z"] <= second["Z"]
    assert whole["Z"].tobytes() == np.where(nearer, first["Z"], second["Z"]).tobytes()
    shifted = np.where(second["particleid"] == NONE, NONE, second["particleid"].astype(np.int64) + cut)
    np.testing.assert_array_equal(whole["particleid"], np.where(nearer, first["particleid"], shifted))
    most = first["count"].astype(np.int64) + second["count"]
    assert (whole["count"] <= most).all() and (whole["count"] >= np.minimum(most, 1)).all()


OUTSIDE = CAMERAS["outside"]


@bounded
@given(scene_names, seeds, choices, st.sampled_from(["behind", "beside", "above", "beyond", "before"]))
def test_splats_off_screen_change_nothing(renderer, name, seed, chosen, where):
    """Such splats lie before the near plane and beyond far too. They come last, so the ids stay."""
    camera = replace(OUTSIDE, near=0.5, far=8.0)
    rng = np.random.default_rng(seed)
    num = 70
    u, v = frames(rng.normal(size=(num, 3)))
    # World offsets from the eye at (0, 0, 3), which looks along -z. The view reaches 0.42 z up and 0.54 z sideways.
    middle = {
        "behind": (0, 0, 9),
        "beside": (12, 0, -3),
        "above": (0, 12, -3),
        "beyond": (0, 0, -13),
        "before": (0, 0, -0.25),
    }
    spread = 0.02 if where == "before" else 1.5
    center = np.array([0, 0, 3]) + middle[where] + rng.uniform(-spread, spread, (num, 3))
    others = Splats(*(a.astype(np.float32) for a in (center, u * spread, v * spread * 0.5)))
    splats = SCENES[name](seed)
    assert not renderer.render(others, camera, chosen)["count"].any()
    alone, both = (arrays(renderer.render(s, camera, chosen)) for s in (splats, joined(splats, others)))
    assert_same_bits(alone, both)


def dyadic(rng, low, high, shape, step):
    """Return random multiples of `step`, a power of two."""
    return rng.integers(int(low / step), int(high / step), shape) * step


@bounded
@given(seeds, choices, st.integers(-40, 40), st.integers(-40, 40), st.sampled_from(["perspective", "orthographic"]))
def test_a_shifted_principal_point_shifts_the_image(renderer, seed, chosen, dx, dy, projection):
    """The image moves by whole pixels and keeps every bit.

    The kernels describe a splat from its projected center, split into a whole pixel and an offset. If this split is
    exact, a shift of cx by a whole number changes the pixel alone, and all other numbers keep their bits. The split is
    exact for a power of two Z, and X, fx, cx with few bits: x = fx X/Z + cx then fits two floats. (A rotation or a
    general Z rounds the last of 48 bits, which sometimes shows in the last bit of an offset.) The position P belongs to
    the ray, so it does not move.
    """
    rng = np.random.default_rng(seed)
    num, size = 150, 64
    center = dyadic(rng, -2, 2, (num, 3), 2.0**-10)
    center[:, 2] = rng.choice([2.0, 4.0, 8.0], num)
    u, v = frames(rng.normal(size=(num, 3)))
    splats = Splats(*(a.astype(np.float32) for a in (center, u * rng.uniform(0.01, 0.5, (num, 1)), v * 0.25)))
    focal = 64.0 if projection == "perspective" else 16.0
    camera = Camera(np.eye(4), focal, focal, 31.25, 32.5, size, size, near=0.5, projection=projection)
    moved = replace(camera, cx=camera.cx + dx, cy=camera.cy + dy)
    a, b = (arrays(renderer.render(splats, c, chosen)) for c in (camera, moved))
    there = np.s_[max(0, dy) : size + min(0, dy), max(0, dx) : size + min(0, dx)]
    here = np.s_[max(0, -dy) : size + min(0, -dy), max(0, -dx) : size + min(0, -dx)]
    assert a["count"].any()
    assert_same_bits(a, {name: np.ascontiguousarray(array[there]) for name, array in b.items()}, here)


@bounded
@given(seeds, cameras, st.sampled_from([(5e5, 4.1e6, 120.0), (-(2.0**21), 2.0**22, 0), (0, 0, 1e5)]))
def test_a_world_far_from_its_origin(renderer, seed, camera, offset):
    """A scene at survey coordinates, in float64, looks the same to its moved camera, within the tolerances."""
    chosen, splats = RenderSettings(epsilon=0.03125), random_ellipses(seed)
    matrix = camera.eye_from_world.copy()
    matrix[:3, 3] -= matrix[:3, :3] @ offset
    far = Splats(splats.center.astype(np.float64) + offset, splats.tangent_u, splats.tangent_v, splats.color)
    a = arrays(renderer.render(splats, camera, chosen))
    b = arrays(renderer.render(far, replace(camera, eye_from_world=matrix), chosen))
    sure = oracle.render(splats, camera, chosen)["margin"] >= MARGIN_UNITS
    assert np.count_nonzero(~sure) < 0.005 * sure.size
    for exact in ("count", "particleid"):
        np.testing.assert_array_equal(a[exact][sure], b[exact][sure])
    hit = sure & np.isfinite(a["Z"])
    np.testing.assert_allclose(a["Z"][hit], b["Z"][hit], rtol=DEPTH_RELATIVE)
    np.testing.assert_allclose(a["albedo"][sure], b["albedo"][sure], rtol=0, atol=RESOLVED)


@bounded
@given(seeds, st.sampled_from([2.0**-8, 0.25, 1024.0, 2.0**20]))
def test_a_scaled_world_keeps_its_bits(renderer, seed, scale):
    """Powers of two scale lengths exactly; coverage, weights and colors keep their bits."""
    splats = random_ellipses(seed)
    camera = replace(OUTSIDE, near=0.5, far=8.0)
    matrix = camera.eye_from_world.copy()
    matrix[:3, 3] *= scale
    larger = replace(camera, eye_from_world=matrix, near=0.5 * scale, far=8.0 * scale)
    scaled = Splats(splats.center * scale, splats.tangent_u * scale, splats.tangent_v * scale, splats.color)
    a = arrays(renderer.render(splats, camera, RenderSettings(epsilon=0.0625)))
    b = arrays(renderer.render(scaled, larger, RenderSettings(epsilon=0.0625 * scale)))
    for name in ("count", "particleid", "weight", "albedo", "N"):
        assert a[name].tobytes() == b[name].tobytes(), name
    for name in ("Z", "depth.mean", "P"):
        assert (a[name] * np.float32(scale)).tobytes() == b[name].tobytes(), name


@pytest.mark.parametrize("facing", ["keep", "cull"])
def test_normals_without_a_sign_are_turned_toward_the_eye(renderer, facing):
    splats, camera = random_ellipses(), CAMERAS["outside"]
    unsigned = replace(splats, oriented=False, on_invalid="error")
    got = renderer.render(unsigned, camera, RenderSettings(epsilon=0.03125, facing=facing))
    want = renderer.render(splats, camera, RenderSettings(epsilon=0.03125, facing="flip"))
    assert all(np.array_equal(got[name], want[name]) for name in got)
