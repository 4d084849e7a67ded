"""Decimated splats are few, keep their error bounds and leave no holes; notes name the data that they lose."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import tolerances as tol
from helpers.cli_stub import run
from helpers.paths import ROOT
from helpers.point_sets import discs, fibonacci_sphere, plane, rim_errors
from helpers.scenes import joined
from scipy.spatial import cKDTree

import splatcl
from splatcl import Splats, decimate
from splatcl.errors import SettingsError

SCANS = ROOT / "reference_images" / "scans"
RIM = 2 * np.pi * np.arange(8) / 8


def sphere(num=4000):
    points = fibonacci_sphere(num)
    return discs(points, points, 2.2 / num**0.5)


def waves():
    """Return a jittered sheet with waves along x and some noise."""
    rng = np.random.default_rng(1)
    x, y = np.meshgrid(np.arange(50.0), np.arange(40.0))
    x, y = (a.ravel() + rng.uniform(-0.2, 0.2, a.size) for a in (x, y))
    points = np.stack([x, y, 2 * np.sin(x / 5) + rng.normal(0, 0.01, x.size)], axis=1)
    normals = np.stack([-0.4 * np.cos(x / 5), 0 * x, 1 + 0 * x], axis=1)
    return discs(points, normals, 1.0)


def is_covered(splats, fewer, error, angle, slack):
    """Return whether an output splat within the bounds holds each center, and whether one holds each whole disc."""
    center, disc = np.zeros((2, len(splats)), bool)
    u, v, normal = splats.tangent_u, splats.tangent_v, fewer.normal
    rims = np.array([0 * u, *(np.cos(a) * u + np.sin(a) * v for a in RIM)])
    places = splats.center.astype(float) + rims
    to_disc = np.linalg.inv(np.stack([fewer.tangent_u, fewer.tangent_v, normal], axis=2))
    cosine = np.abs if not splats.oriented else np.asarray
    near = cKDTree(splats.center).query_ball_point(fewer.center, 1.1 * fewer.radius + error)
    for i, ids in enumerate(near):
        ids = np.array(ids)[cosine(splats.normal[ids] @ normal[i]) >= np.cos(np.radians(angle)) - slack]
        coordinates = (places[:, ids] - fewer.center[i]) @ to_disc[i].T
        radius = np.hypot(coordinates[..., 0], coordinates[..., 1])
        within = np.abs(coordinates[0, :, 2]) <= error * (1 + slack)
        center[ids] |= within & (radius[0] <= 1 + slack)
        disc[ids] |= within & (radius <= 1 + slack).all(axis=0)
    return center, disc


@pytest.mark.parametrize(
    ("make", "error", "angle", "most"),
    [(sphere, 0.004, 30, 0.15), (sphere, 0.02, 30, 0.04), (sphere, 0.5, 15, 0.06), (waves, 0.1, 30, 0.06)],
)
def test_every_center_is_within_the_bounds_of_a_splat_that_covers_its_disc(make, error, angle, most):
    splats = make()
    fewer = decimate(splats, error, angle=angle)
    center, disc = is_covered(splats, fewer, error, angle, tol.BOUND_SLACK)
    assert center.all() and disc.all()
    assert len(fewer) < most * len(splats)


def test_the_bunny():
    splats = splatcl.read(SCANS / "bunny.pts")
    fewer = decimate(splats, 0.001)
    center, disc = is_covered(splats, fewer, 0.001, 30, tol.BOUND_SLACK_SINGLE)
    assert center.all() and disc.all() and len(fewer) < len(splats) / 40
    assert not fewer.oriented and fewer.center.dtype == splats.center.dtype
    assert fewer.notes == (*splats.notes, f"decimated 30571 splats to {len(fewer)}: error 0.001, angle 30 degrees")


def test_the_bound_is_two_sided():
    """A plane may cut a cap of a sphere off that is twice as high as the error."""
    fewer = decimate(sphere(), 0.02)
    radius = np.sqrt(1 - 0.96**2)
    assert np.median(fewer.radius) > 0.9 * radius
    distance = np.einsum("ni,ni->n", fewer.center, fewer.normal)
    assert 0.97 < np.median(distance) < 0.99


def test_ellipses_are_long_where_the_surface_is_less_curved():
    fewer = decimate(waves(), 0.05)
    lengths = np.linalg.norm([fewer.tangent_u, fewer.tangent_v], axis=2)
    assert np.median(lengths[0] / lengths[1]) > 2
    along = np.abs(fewer.tangent_u[:, 1]) / lengths[0]
    assert np.median(along) > 0.95


def test_a_plane_becomes_a_few_splats_that_hardly_exceed_it():
    splats = plane(40, 40)
    fewer = decimate(splats, 0.1)
    assert len(fewer) <= 8
    assert (np.abs(fewer.bounds - splats.bounds) < 15)[:, :2].all() and not fewer.bounds[:, 2].any()


def test_gaps_are_not_bridged_and_back_and_front_are_not_joined():
    upper = plane()
    far, back = (
        Splats(upper.center + offset, *axes)
        for offset, axes in (
            ((20.0, 0, 0), (upper.tangent_u, upper.tangent_v)),
            ((0, 0, -0.01), (upper.tangent_v, upper.tangent_u)),
        )
    )
    both = joined(upper, far, back)
    fewer = decimate(both, 0.1)
    assert len(fewer) < 20
    assert is_covered(both, fewer, 0.1, 30, tol.BOUND_SLACK)[1].all()
    # The gap between the two is 9 - 2 * 0.75 units wide.
    left, right = (fewer.center - np.hypot(fewer.tangent_u, fewer.tangent_v))[:, 0], fewer.center[:, 0]
    assert not ((right > 18) & (left < 13)).any()


def test_signs_of_unoriented_normals_are_ignored():
    splats = sphere(1000)
    turned = np.arange(1000)[:, None] % 3 == 0
    u, v = splats.tangent_u, splats.tangent_v
    mixed = Splats(splats.center, np.where(turned, v, u), np.where(turned, u, v), oriented=False)
    expected, fewer = decimate(splats, 0.02), decimate(mixed, 0.02)
    assert not fewer.oriented and len(fewer) == len(expected)
    np.testing.assert_allclose(fewer.center, expected.center, rtol=0, atol=tol.BOUND_SLACK)


def test_the_same_splats_give_the_same_result():
    first, second = (decimate(waves(), 0.1) for _ in range(2))
    for name in ("center", "tangent_u", "tangent_v", "color"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))


def test_survey_coordinates_cost_nothing():
    splats = waves()
    moved = replace(splats, center=splats.center + np.array([400_000.0, 5_000_000.0, 0.0]))
    fewer = decimate(moved, 0.1)
    center, disc = is_covered(moved, fewer, 0.1, 30, tol.BOUND_SLACK_SURVEY)
    assert center.all() and disc.all()


def test_colors_and_attributes_are_means_by_area():
    splats = Splats(
        np.zeros((2, 3)),
        [[1.0, 0, 0], [2.0, 0, 0]],
        [[0.0, 1, 0], [0.0, 1.5, 0]],
        [[1.0, 0, 0], [0.0, 1, 0]],
        attributes={"heat": np.array([4.0, 8.0])},
    )
    fewer = decimate(splats, 0.1)
    assert len(fewer) == 1
    np.testing.assert_allclose(fewer.color[0], [0.25, 0.75, 0.0], rtol=tol.BOUND_SLACK)
    np.testing.assert_allclose(fewer.attributes["heat"], [7.0], rtol=tol.BOUND_SLACK)


def test_fields_are_fitted_to_what_is_covered():
    fewer = decimate(sphere(), 0.005, fields=True)
    error, constant = rim_errors(replace(fewer, center=fewer.normal), 1.0)
    assert fewer.normal_du is not None and error < 0.3 * constant


def test_what_is_not_carried_over_is_noted():
    splats = replace(splatcl.normal_fields(plane()), clip=np.zeros((144, 2, 3)))
    fewer = decimate(splats, 0.1)
    assert fewer.normal_du is None and fewer.clip is None
    assert fewer.notes[1:] == tuple(
        f"dropped the {what} of the original splats" for what in ("normal fields", "clip lines")
    )


def test_degenerate_sets():
    one = plane(1, 1)
    same = decimate(one, 0.1)
    assert len(same) == 1 and len(decimate(one.take([]), 0.1)) == 0
    assert one.radius <= same.radius <= 1.01 * one.radius
    copies = Splats(*(np.repeat(getattr(one, name), 100, axis=0) for name in ("center", "tangent_u", "tangent_v")))
    assert len(decimate(copies, 0.1)) == 1
    opposed = joined(copies, Splats(copies.center, copies.tangent_v, copies.tangent_u))
    assert len(decimate(opposed, 0.1)) == 2


@pytest.mark.parametrize(
    ("error", "angle"), [(0, 30), (-1, 30), (np.nan, 30), (np.inf, 30), (1, 0), (1, 61), (1, np.nan)]
)
def test_mistakes(error, angle):
    with pytest.raises(SettingsError, match=r"^(error|angle) \S+ must be"):
        decimate(plane(), error, angle=angle)


def test_the_command_writes_fewer_splats(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    splatcl.write(plane(), "plane.npz")
    status, out, err = run(capsys, "decimate plane.npz -o out.ply --error 0.1 --fields")
    fewer = decimate(plane(), 0.1, fields=True)
    assert (status, err) == (0, []) and out[1].startswith(f"decimated 144 splats to {len(fewer)} (1 for ")
    assert out[2].startswith("wrote out.ply (") and len(out) == 3
    written = splatcl.read("out.ply")
    for name in ("center", "tangent_u", "tangent_v", "color", "normal_du", "normal_dv"):
        np.testing.assert_array_equal(getattr(written, name), getattr(fewer, name))
    for options, message in (("--error 0", "--error 0.0 must"), ("--error 1 --angle 90", "--angle 90.0 must")):
        status, _, err = run(capsys, f"decimate plane.npz -o out.npz {options}")
        assert status == 2 and err[0].startswith(f"splatcl: error: {message}")
    assert run(capsys, "decimate plane.npz -o missing/out.ply --error 1")[0] == 2
