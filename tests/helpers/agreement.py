"""Compare the device's results with the oracle's, outside the pixels where a decision is nearly a tie."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
from helpers.scenes import CAMERAS, ORDINARY, SCENES
from tolerances import (
    DEPTH_RELATIVE,
    DEPTH_UNITS,
    DOUBLE_ADVERSARIAL,
    DOUBLE_RELATIVE,
    DOUBLE_UNITS,
    MARGIN_UNITS,
    MASKED,
    MASKED_OTHERWISE,
    RESOLVED,
    RESOLVED_NEEDLES,
    WEIGHT_ADVERSARIAL,
    WEIGHT_RELATIVE,
)

from splatcl import Splats
from splatcl.oracle.attributes import attributes
from splatcl.oracle.buffers import NO_SPLAT
from splatcl.oracle.geometry.discs import Discs, intersect
from splatcl.oracle.geometry.rays import pixel_rays
from splatcl.oracle.project import project
from splatcl.oracle.visibility import visibility


@cache
def scene(name, seed=0) -> Splats:
    return SCENES[name](seed)


@cache
def expected(scene_name, camera_name, settings, seed=0):
    """Return the oracle's `projected`, `depth`, `gbuffer`, and `depth_scale` (H, W) of the depth's rounding error."""
    splats, camera = scene(scene_name, seed), CAMERAS[camera_name]
    projected = project(splats, camera, settings)
    depth = visibility(projected, camera, settings)
    gbuffer = attributes(projected, depth, splats, camera, settings, settings.epsilon)
    hits = intersect(Discs.of(projected, camera), camera, pixel_rays(camera)[:, None])
    front = np.where(depth.particleid == NO_SPLAT, 0, depth.particleid).astype(np.int64)
    scale = np.take_along_axis(hits.scale_z, front.reshape(-1, 1), axis=1).reshape(front.shape)
    return SimpleNamespace(projected=projected, depth=depth, gbuffer=gbuffer, depth_scale=scale)


def reference(scene_name, camera_name, settings, seed=0):
    """Return `expected` for any precision of the device."""
    return expected(scene_name, camera_name, replace(settings, precision="single"), seed)


def trusted(margin, covered, settings, scene_name):
    """Return (H, W) bool where no decision is nearly a tie; assert that it leaves out few covered pixels."""
    ok = margin >= (MARGIN_UNITS if settings.precision == "single" else DOUBLE_UNITS)
    num_masked, num_covered = np.count_nonzero(~ok & covered), np.count_nonzero(covered)
    cap = MASKED.get(scene_name, MASKED_OTHERWISE) * num_covered
    assert num_masked <= max(cap, 1), f"{num_masked} of {num_covered} covered pixels are nearly tied"
    return ok


def assert_visibility_agrees(got, want, settings, scene_name):
    """Assert equal coverage and front-most splats, and equal depths to a tolerance, where decisions are certain."""
    depth = want.depth
    ok = trusted(depth.margin, np.isfinite(depth.depth), settings, scene_name)
    np.testing.assert_array_equal(np.isfinite(got["depth"])[ok], np.isfinite(depth.depth)[ok])
    np.testing.assert_array_equal(got["particleid"][ok], depth.particleid[ok])
    hit = ok & np.isfinite(depth.depth)
    relative, unit = (DEPTH_RELATIVE, 2.0**-24) if settings.precision == "single" else (DOUBLE_RELATIVE, 2.0**-53)
    allowed = relative * np.abs(depth.depth[hit])
    if scene_name not in ORDINARY:
        allowed = np.maximum(allowed, DEPTH_UNITS * unit * want.depth_scale[hit])
    error = np.abs(got["depth"][hit] - depth.depth[hit])
    assert (error <= allowed).all(), f"depth is off by {(error / allowed).max():.3g} times what is allowed"


def assert_attributes_agree(got, want, settings, scene_name):
    """Assert equal fragments, and equal weights and means to a tolerance, where decisions are certain."""
    gbuffer = want.gbuffer
    margin = np.minimum(want.depth.depth_margin, gbuffer.margin)
    ok = trusted(margin, gbuffer.weight_sum > 0, settings, scene_name)
    np.testing.assert_array_equal(got["count"][ok], gbuffer.count[ok])
    np.testing.assert_array_equal((got["weight_sum"] > 0)[ok], (gbuffer.weight_sum > 0)[ok])
    empty = ok & (gbuffer.weight_sum == 0)
    assert not any(got[name][empty].any() for name in ("color_sum", "normal_sum", "depth_sum"))

    if settings.precision == "double":
        weight_tolerance = tolerance = DOUBLE_RELATIVE if scene_name in ORDINARY else DOUBLE_ADVERSARIAL
    elif scene_name in ORDINARY:
        weight_tolerance, tolerance = WEIGHT_RELATIVE, RESOLVED
    else:
        weight_tolerance, tolerance = WEIGHT_ADVERSARIAL, RESOLVED_NEEDLES if scene_name == "thin" else RESOLVED
    covered = ok & (gbuffer.weight_sum > 0)
    weight = gbuffer.weight_sum[covered]
    np.testing.assert_allclose(got["weight_sum"][covered], weight, rtol=weight_tolerance)
    for name in ("color_sum", "normal_sum", "depth_sum"):
        resolved, expected_ = (
            (sums[covered].astype(np.float64).T / weights[covered]).T
            for sums, weights in (
                (got[name], got["weight_sum"]),
                (getattr(gbuffer, name), gbuffer.weight_sum),
            )
        )
        # A depth near 0 (orthographic) is a difference of coordinates of about 1.
        relative = tolerance if name == "depth_sum" else 0
        np.testing.assert_allclose(resolved, expected_, rtol=relative, atol=tolerance, err_msg=name)
