"""The projection against the specification's equations: records, bounds, normals and the surviving splats."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from helpers.agreement import reference, scene
from helpers.device_passes import DevicePasses
from helpers.scenes import CAMERAS, EPSILON, VIEWS
from tolerances import (
    BOUNDS_LOOSER,
    BOUNDS_LOOSER_SIZE,
    BOUNDS_LOOSER_TILT,
    COEFFICIENT_UNITS,
    MARGIN_UNITS,
    NORMAL_UNITS,
    PREFILTER_POINT_UNITS,
    REFERENCE_PIXELS,
)

from splatcl import RenderSettings, oracle
from splatcl.oracle.geometry.rays import EDGE_ON

UNIT = {"single": 2.0**-24, "double": 2.0**-53}
SETTINGS = {
    "min": RenderSettings(epsilon=EPSILON),
    "none": RenderSettings(epsilon=EPSILON, prefilter="none"),
    "cull": RenderSettings(epsilon=EPSILON, facing="cull"),
    "flip": RenderSettings(epsilon=EPSILON, facing="flip"),
    "bounds": RenderSettings(epsilon=EPSILON, prefilter_center="bounds", prefilter_radius=1.75),
    "double": RenderSettings(epsilon=EPSILON, prefilter_center="bounds", precision="double"),
}
AMPLE = ("outside", "off_center", "orthographic")


def project(device, scene_name, camera_name, settings):
    return DevicePasses(device, scene(scene_name), CAMERAS[camera_name], settings).project()


DEEP = 0.25
"""Share of its center's z beyond which a disc is deep; DEEP in kernels/passes/project.cl."""


@cache
def spec(scene_name, camera_name, name):
    """Return the record of each splat by the specification's equations, float64, from its eye-space vectors.

    `point` is the reference point of the record. It is the center, or the disc's farthest point where a perspective
    camera has the center in front of its near plane, or where the disc is deep. d0 is the ray through the reference
    point; a = t_v x c, b = c x t_u, g = t_u x t_v. The ray of a pixel (dx, dy) away is d0 + (dx/fx, dy/fy, 0), so
    u = a.d / g.d = (u_1 + dx a_x/(fx g.d0) + dy a_y/(fy g.d0)) / (1 + g_x dx + g_y dy).
    """
    camera = CAMERAS[camera_name]
    p = reference(scene_name, camera_name, SETTINGS[name]).projected
    c, t_u, t_v = p.center_eye, p.tangent_u_eye, p.tangent_v_eye
    perspective = camera.projection == "perspective"
    reach = np.hypot(t_u[:, 2], t_v[:, 2])
    hidden = perspective & ((c[:, 2] < camera.near) | (reach > DEEP * c[:, 2]))
    u_1, v_1 = (np.where(hidden, t[:, 2] / reach, 0.0) for t in (t_u, t_v))
    point = c + u_1[:, None] * t_u + v_1[:, None] * t_v
    a, b, g = np.cross(t_v, c), np.cross(c, t_u), np.cross(t_u, t_v)
    focal = np.array([camera.fx, camera.fy])
    with np.errstate(divide="ignore", invalid="ignore"):
        if perspective:
            g_d0 = (g * point).sum(axis=1) / point[:, 2]
            image = point[:, :2] / point[:, 2:]
            coefficients = [h[:, :2] / focal / g_d0[:, None] for h in (a, b, g)]
        else:
            # The ray is (X, Y, 0) + z (0, 0, 1), so t_v x (c - (X, Y, 0)) gives the change of a with X and Y.
            g_d0, image = g[:, 2], point[:, :2]
            forms = np.stack([t_v[:, 1], -t_v[:, 0]]), np.stack([-t_u[:, 1], t_u[:, 0]]), -g[:, :2].T
            coefficients = [h.T / focal / g_d0[:, None] for h in forms]
        # Each coefficient is a difference of products of this size; g.d0 has an error too.
        length_u, length_v = np.linalg.norm(t_u, axis=1), np.linalg.norm(t_v, axis=1)
        distance = np.linalg.norm(point, axis=1) if perspective else 1.0
        cosine = np.abs(g_d0) / np.linalg.norm(g, axis=1)
        steep = 1 + length_u * length_v / np.linalg.norm(g, axis=1) / cosine
        sizes = [size / np.abs(g_d0) for size in (length_v * distance, length_u * distance, length_u * length_v)]
        scales = [
            (size[:, None] / focal + np.abs(k)) * steep[:, None] for size, k in zip(sizes, coefficients, strict=True)
        ]
        # A rounded step along the disc leads to the farthest point, and z may cancel there.
        cancels = np.where(hidden, (np.abs(c[:, 2]) + reach) / np.abs(point[:, 2]), 1.0)
        step = np.where(hidden, np.linalg.norm(point - c, axis=1) / np.abs(point[:, 2]), 0.0)
        # The step depends on t.z / reach, with the rounding error of |t|. Any point of the disc would serve.
        steps_off = 1 + np.where(hidden, np.maximum(length_u, length_v) / reach, 0.0)
        moved = (step * steps_off)[:, None] * focal * (1 + np.abs(image))
    raster = image * focal + (camera.cx, camera.cy)
    return SimpleNamespace(
        projected=p, point=point, raster=raster, moved=moved, cancels=cancels,
        u_1=u_1, v_1=v_1, coefficients=coefficients, scales=scales,
    )  # fmt: skip


def cosines(p, camera):
    """Return (N,) |cos| of the angle between each splat's normal and the line of sight to its center."""
    toward = p.center_eye / np.linalg.norm(p.center_eye, axis=1)[:, None]
    toward = toward if camera.projection == "perspective" else np.array([0, 0, 1.0])
    g = np.cross(p.tangent_u_eye, p.tangent_v_eye)
    return np.abs((g * toward).sum(axis=1)) / np.linalg.norm(g, axis=1)


def edge_on(p, camera):
    """Return (N,) bool surely edge-on and (N,) bool surely not."""
    return cosines(p, camera) < 0.9 * EDGE_ON, cosines(p, camera) > 1.1 * EDGE_ON


def slack(p, camera):
    """Return (N,) pixels by which a record's bounds may exceed the oracle's."""
    size = np.maximum(p.bounds[:, 2] - p.bounds[:, 0], p.bounds[:, 3] - p.bounds[:, 1])
    size = np.where(np.isfinite(size), size, 0)
    return BOUNDS_LOOSER + size * (BOUNDS_LOOSER_SIZE + BOUNDS_LOOSER_TILT / cosines(p, camera))


@pytest.mark.parametrize("name", ["min", "double"])
@pytest.mark.parametrize(("scene_name", "camera_name"), VIEWS)
def test_coefficients_and_reference_point(device, scene_name, camera_name, name):
    settings, camera = SETTINGS[name], CAMERAS[camera_name]
    records, _ = project(device, scene_name, camera_name, settings)
    want, ids, unit = spec(scene_name, camera_name, name), records["id"], UNIT[settings.precision]
    assert len(ids) or camera_name != "outside"

    z, steep = want.point[ids, 2], want.cancels[ids]
    if settings.precision == "double":  # the oracle's own z has an error of the world's size (about 4)
        steep = steep + 4 / np.abs(z)

    pixel = np.stack([records["pixel_x"], records["pixel_y"]], axis=1).astype(np.float64)
    offset = np.stack([records["offset_x"], records["offset_y"]], axis=1).astype(np.float64)
    raster = want.raster[ids] - 0.5
    error = np.abs(pixel + offset - raster)
    allowed = REFERENCE_PIXELS[settings.precision] + 4 * unit * want.moved[ids]
    if settings.precision == "double":
        allowed = allowed + 4 * unit * np.abs(raster) * steep[:, None]
    assert (pixel == np.rint(pixel)).all()
    assert (error <= allowed).all(), f"the reference point is off by {error.max():.2g} pixels"
    # Floats of a very far reference point are over half a pixel apart; `pixel` is then any near one.
    assert (np.abs(offset) <= 0.5 + 2 * unit * (1 + np.abs(pixel))).all()

    assert (np.abs(records["z"] - z) <= 4 * unit * np.abs(z) * steep).all()
    never, surely = (mask[ids] for mask in edge_on(want.projected, camera))
    assert (records["u_1"][never] == 2).all()
    assert not any(records[k][never].any() for k in ("u_x", "u_y", "v_x", "v_y", "g_x", "g_y"))
    np.testing.assert_allclose(records["u_1"][surely], want.u_1[ids][surely], atol=8 * unit)
    np.testing.assert_allclose(records["v_1"][surely], want.v_1[ids][surely], atol=8 * unit)
    for letter, value, scale in zip("uvg", want.coefficients, want.scales, strict=True):
        got = np.stack([records[f"{letter}_x"], records[f"{letter}_y"]], axis=1)[surely]
        error = np.abs(got - value[ids][surely]) / (unit * scale[ids] * steep[:, None])[surely]
        assert (error <= COEFFICIENT_UNITS).all(), f"{letter} is off by {error.max():.2g} units"


@pytest.mark.parametrize("name", SETTINGS)
@pytest.mark.parametrize(("scene_name", "camera_name"), [v for v in VIEWS if v[1] in AMPLE])
def test_which_splats_survive(device, scene_name, camera_name, name):
    """Splats survive, in increasing order, if their bounds reach a pixel's center, up to the bounds' slack."""
    settings, camera = SETTINGS[name], CAMERAS[camera_name]
    records, attributes = project(device, scene_name, camera_name, settings)
    p = reference(scene_name, camera_name, settings).projected
    ids = records["id"]
    assert (np.diff(ids.astype(np.int64)) > 0).all() and len(attributes) == len(ids)

    x_min, y_min, x_max, y_max = p.bounds.T

    def reach(more):
        x_first, x_last = np.ceil(x_min - more - 0.5), np.floor(x_max + more - 0.5)
        y_first, y_last = np.ceil(y_min - more - 0.5), np.floor(y_max + more - 0.5)
        x = np.maximum(x_first, 0) <= np.minimum(x_last, camera.width - 1)
        return x & (np.maximum(y_first, 0) <= np.minimum(y_last, camera.height - 1))

    decided = np.abs(p.facing_margin) >= MARGIN_UNITS
    never, surely = edge_on(p, camera)
    decided &= never | surely
    survivors = np.isin(np.arange(len(decided)), ids)
    infinite = np.isinf(p.bounds).any(axis=1) & (x_min <= x_max)
    possible = infinite | reach(slack(p, camera))
    surely_seen = ~infinite & reach(0)
    assert survivors[decided & surely_seen].all()
    assert not survivors[decided & ~possible].any()
    assert not survivors[decided & p.culled].any()
    if name == "cull" and scene_name not in ("near_plane", "layers"):
        assert 0 < np.count_nonzero(p.culled) < len(p.culled)


@pytest.mark.parametrize("name", ["min", "none", "bounds", "double"])
@pytest.mark.parametrize(("scene_name", "camera_name"), [v for v in VIEWS if v[1] in AMPLE])
def test_bounds_are_tight(device, scene_name, camera_name, name):
    """Bounds hold the oracle's exact bounds and are hardly looser, except for discs through the eye plane."""
    settings, camera = SETTINGS[name], CAMERAS[camera_name]
    records, _ = project(device, scene_name, camera_name, settings)
    p = reference(scene_name, camera_name, settings).projected
    _, surely = edge_on(p, camera)
    low, high = p.bounds[records["id"], :2], p.bounds[records["id"], 2:]
    got_low = np.stack([records["x_min"], records["y_min"]], axis=1).astype(np.int64)
    got_high = np.stack([records["x_max"], records["y_max"]], axis=1).astype(np.int64)
    last = np.array([camera.width, camera.height]) - 1
    assert (got_low >= 0).all() and (got_high <= last).all() and (got_low <= got_high).all()

    exact = surely[records["id"]] & np.isfinite(p.bounds[records["id"]]).all(axis=1)
    low, high, got_low, got_high = low[exact], high[exact], got_low[exact], got_high[exact]
    assert (got_low <= np.maximum(np.ceil(low - 0.5), 0)).all()
    assert (got_high >= np.minimum(np.floor(high - 0.5), last)).all()
    center, t = p.center_eye[records["id"]][exact], p.tangent_u_eye[records["id"]][exact]
    reach = np.hypot(t[:, 2], p.tangent_v_eye[records["id"]][exact, 2])
    clear = (center[:, 2] - reach > 2e-4 * center[:, 2]) & (center[:, 2] >= camera.near)
    clear |= camera.projection == "orthographic"
    more = slack(p, camera)[records["id"]][exact, None]
    looser_low, looser_high = np.ceil(low - more - 0.5), np.floor(high + more - 0.5)
    assert (got_low >= np.clip(looser_low, 0, last))[clear].all()
    assert (got_high <= np.clip(looser_high, 0, last))[clear].all()


@pytest.mark.parametrize("camera_name", ["close", "off_center", "orthographic"])
@pytest.mark.parametrize("scene_name", ["near_plane", "giant", "edge_on", "thin", "random_ellipses"])
def test_bounds_hold_every_pixel_of_the_splat(device, scene_name, camera_name):
    """The oracle draws each splat alone; its certain pixels lie within its record's bounds."""
    settings, camera, splats = SETTINGS["min"], CAMERAS[camera_name], scene(scene_name)
    records, _ = project(device, scene_name, camera_name, settings)
    bounds = {r["id"]: [int(r[k]) for k in ("x_min", "y_min", "x_max", "y_max")] for r in records}
    num_covered = 0
    for i in range(0, len(splats), 2):
        alone = oracle.render(splats.take([i]), camera, settings)
        covered = (alone["count"] > 0) & (alone["margin"] >= MARGIN_UNITS)
        rows, columns = np.nonzero(covered)
        num_covered += len(rows)
        if len(rows):
            x_min, y_min, x_max, y_max = bounds[i]
            assert x_min <= columns.min() and columns.max() <= x_max
            assert y_min <= rows.min() and rows.max() <= y_max
    assert num_covered > 50


@pytest.mark.parametrize("name", ["min", "flip", "cull", "double"])
@pytest.mark.parametrize("camera_name", CAMERAS)
@pytest.mark.parametrize("scene_name", ["random_ellipses", "thin", "near_plane"])
def test_normals_and_colors(device, scene_name, camera_name, name):
    settings = SETTINGS[name]
    records, attributes = project(device, scene_name, camera_name, settings)
    p, ids, unit = reference(scene_name, camera_name, settings).projected, records["id"], UNIT[settings.precision]
    color = np.stack([attributes[k] for k in ("red", "green", "blue")], axis=1)
    np.testing.assert_array_equal(color, scene(scene_name).color[ids])
    got = np.stack([attributes[f"normal_{k}"] for k in "xyz"], axis=1).astype(np.float64)
    decided = np.abs(p.facing_margin[ids]) >= MARGIN_UNITS
    np.testing.assert_allclose(got[decided], p.normal_eye[ids][decided], rtol=0, atol=NORMAL_UNITS * unit)
    if name == "flip" and CAMERAS[camera_name].projection == "perspective":
        assert ((got * p.center_eye[ids]).sum(axis=1)[decided] < 0).all()


@pytest.mark.parametrize("name", ["min", "none", "bounds", "double"])
@pytest.mark.parametrize("camera_name", AMPLE)
@pytest.mark.parametrize("scene_name", ["random_ellipses", "near_plane", "sub_pixel"])
def test_centers_of_the_prefilter(device, scene_name, camera_name, name):
    settings = SETTINGS[name]
    records, attributes = project(device, scene_name, camera_name, settings)
    p, ids = reference(scene_name, camera_name, settings).projected, records["id"]
    got = np.stack([attributes["prefilter_x"], attributes["prefilter_y"]], axis=1).astype(np.float64)
    sure = np.abs(p.prefilter_margin[ids]) >= MARGIN_UNITS
    absent = sure & (p.prefilter_margin[ids] < 0)
    assert (got[absent] == 1e9).all()
    present = sure & (p.prefilter_margin[ids] > 0)
    point = [records[f"pixel_{axis}"].astype(np.float64) + records[f"offset_{axis}"] for axis in "xy"]
    error = np.abs(np.stack(point, axis=1) + got - (p.prefilter_center[ids] - 0.5))[present]
    allowed = PREFILTER_POINT_UNITS * UNIT[settings.precision] * p.prefilter_error[ids][present, None]
    allowed = allowed + 2 * UNIT[settings.precision] * np.abs(got)[present]
    allowed = allowed + (REFERENCE_PIXELS["double"] if settings.precision == "double" else 0)
    assert (error <= allowed).all(), f"off by {(error / allowed).max():.3g} of what is allowed"
    assert present.any() == (settings.prefilter == "min")
