"""Normal fields against known normals of surfaces, and from too few neighbors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import tolerances as tol
from helpers.cli_stub import run
from helpers.point_sets import discs, fibonacci_sphere, plane, rim_errors
from helpers.scenes import joined

import splatcl
from splatcl import Splats, fit_normal_fields, normal_fields
from splatcl.errors import InvalidSplatsError


def sphere(num=2000, scale=5.0, radius=0.05):
    points = fibonacci_sphere(num)
    return discs(points * scale, points, radius * scale)


def assert_constant(splats):
    assert not splats.normal_du.any() and not splats.normal_dv.any()


@pytest.mark.parametrize("scale", [0.001, 5.0])
def test_on_a_sphere_estimated_fields_are_its_normals_to_second_order(scale):
    error, constant = rim_errors(normal_fields(sphere(scale=scale)), scale)
    assert constant > 0.04 and error < tol.FIELD_OF_CONSTANT * constant


def test_on_a_sphere_fitted_fields_are_its_normals_to_second_order():
    points = fibonacci_sphere(30_000)
    error, constant = rim_errors(fit_normal_fields(sphere(200), 5 * points, 3 * points), 5.0)
    assert constant > 0.04 and error < tol.FIELD_OF_CONSTANT * constant


@pytest.mark.parametrize("tangents", [((0.5, 0, 0), (0, 0.25, 0)), ((0.5, 0.1, 0), (-0.2, 0.3, 0))])
def test_on_a_paraboloid_fields_are_exact_for_any_tangents(tangents):
    """A disc touches z = x^2 / 2 - x y / 4 + y^2 / 5 at the origin, so n_du is minus the Hessian times t_u."""
    hessian = np.array([[1, -0.25], [-0.25, 0.4]])
    xy = np.random.default_rng(0).uniform(-0.3, 0.3, (300, 2))
    points = np.column_stack([xy, 0.5 * np.einsum("pi,ij,pj->p", xy, hessian, xy)])
    normals = np.column_stack([-xy @ hessian, np.ones(len(xy))])
    splats = fit_normal_fields(Splats([[0.0, 0, 0]], *(np.array([t]) for t in tangents)), points, normals)
    for field, tangent in zip((splats.normal_du, splats.normal_dv), tangents, strict=True):
        np.testing.assert_allclose(field[0], [*(-hessian @ tangent[:2]), 0.0], rtol=0, atol=tol.FIELD_EXACT)


def test_fields_are_tangential_and_zero_on_a_plane():
    splats = normal_fields(plane())
    np.testing.assert_allclose([splats.normal_du, splats.normal_dv], 0.0, rtol=0, atol=tol.FIELD_EXACT)
    round_ = normal_fields(sphere())
    for field in (round_.normal_du, round_.normal_dv):
        assert np.linalg.norm(field, axis=1).min() > 0.04
        np.testing.assert_allclose(np.einsum("ni,ni->n", field, round_.normal), 0.0, rtol=0, atol=tol.FIELD_EXACT)


def test_signs_of_unoriented_normals_are_ignored():
    splats = sphere(500)
    turned = np.arange(500)[:, None] % 3 == 0
    tangents = (
        np.where(turned, splats.tangent_v, splats.tangent_u),
        np.where(turned, splats.tangent_u, splats.tangent_v),
    )
    same = normal_fields(splats)
    other = normal_fields(Splats(splats.center, *tangents, oriented=False))
    sign = np.where(turned, -1.0, 1.0)  # a turned normal has a turned field, and the test swaps its axes
    du = np.where(turned, other.normal_dv, other.normal_du) * sign
    np.testing.assert_allclose(du, same.normal_du, rtol=0, atol=tol.FIELD_EXACT)


def test_neighbors_of_another_side_have_no_part():
    """Two sheets lie back to back, the lower one bent. Half of the upper sheet's neighbors belong to the lower."""
    upper = plane()
    normals = np.column_stack([0.3 * np.sin(upper.center[:, 0]), 0 * upper.center[:, 0], -np.ones(len(upper))])
    lower = discs(upper.center - (0.0, 0.0, 0.1), normals, 0.75)
    field = normal_fields(joined(upper, lower), 17).normal_du[: len(upper)]
    np.testing.assert_allclose(field, 0.0, rtol=0, atol=tol.FIELD_EXACT)


def test_without_enough_neighbors_the_normal_is_constant():
    line = np.arange(9.0)[:, None] * (1.0, 0.0, 0.0)
    bent = np.column_stack([0.1 * np.arange(9.0), np.zeros(9), np.ones(9)])
    for points in (line[:0], line[:1], line[:3], line, 0 * line):
        splats = discs(points, bent[: len(points)], 0.75) if len(points) else plane().take([])
        assert_constant(normal_fields(splats))
        assert_constant(fit_normal_fields(plane(2, 2), points, bent[: len(points)]))


def test_points_off_the_disc_have_no_part_in_a_fit():
    points = np.array([[0.3, 0, 0], [0, 0.3, 0], [-0.3, 0, 0], [0.1, 0.1, 0.7], [0.9, 0.9, 0], [0.2, 0.2, 0]])
    normals = np.array([[0.0, 0, 1]] * 3 + [[0.5, 0, 1]] * 2 + [[5.0, 0, 1]])
    splats = Splats([[0.0, 0, 0]], [[1.0, 0, 0]], [[0.0, 1, 0]])
    assert_constant(fit_normal_fields(splats, points, normals))


def test_everything_else_is_kept():
    splats = replace(plane(), attributes={"heat": np.arange(144.0)}, clip=np.zeros((144, 2, 3)), notes=("a",))
    result = normal_fields(splats)
    for name in ("center", "tangent_u", "tangent_v", "color", "clip"):
        np.testing.assert_array_equal(getattr(result, name), getattr(splats, name))
    np.testing.assert_array_equal(result.attributes["heat"], splats.attributes["heat"])
    assert result.notes == ("a",) and result.oriented


def test_mistakes():
    with pytest.raises(InvalidSplatsError, match="num_neighbors is 2"):
        normal_fields(plane(), 2)
    with pytest.raises(InvalidSplatsError, match="normals has shape"):
        fit_normal_fields(plane(), np.zeros((3, 3)), np.zeros((2, 3)))
    with pytest.raises(
        InvalidSplatsError, match=r"1 of 3 points \(1 with a zero .*; the first is point 1\) cannot be used"
    ):
        fit_normal_fields(plane(), np.zeros((3, 3)), [[0, 0, 1], [0, 0, 0], [0, 0, 1]])


def test_the_command_writes_splats_with_fields(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    splatcl.write(plane(), "plane.npz")
    status, out, err = run(capsys, "fields plane.npz -o out.ply --num-neighbors 8")
    assert (status, err) == (0, []) and out[0].startswith("read plane.npz: 144 splats")
    assert out[1].startswith("estimated 144 normal fields in ") and out[2].startswith("wrote out.ply")
    expected = normal_fields(plane(), 8)
    np.testing.assert_array_equal(splatcl.read("out.ply").normal_du, expected.normal_du)
    status, _, err = run(capsys, "fields plane.npz -o out.xyz")
    assert status == 2 and err[0].endswith("cannot write .xyz; use .ply or .npz")
    status, _, err = run(capsys, "fields plane.npz -o out.ply --num-neighbors 2")
    assert status == 2 and err[0].startswith("splatcl: error: --num-neighbors is 2;")
