"""Sharp features: lines that two splats share, and the cube of 24 splats."""

import numpy as np
import pytest
import tolerances as tol
from helpers.feature_rays import cast, disc_coordinates, kept, slabs

from splatcl import Camera, Splats
from splatcl.errors import InvalidSplatsError, SettingsError
from splatcl.features import clip_lines, cube
from splatcl.prepare.features.clip_lines import cut_depth, evaluate, keep_deepest, normalize


def roofs(num, seed=0):
    """Return splats 2k and 2k + 1 on both sides of random edges, the edges' points and directions, and convexity.

    Points are edge + t along + s across, with s < 0 on the side of splat 2k and s > 0 on the side of splat 2k + 1.
    """
    rng = np.random.default_rng(seed)
    along, across = np.empty((num, 3)), np.empty((2, num, 3))
    rows = []
    edge = rng.normal(size=(num, 3)) * 10
    convex = rng.random(num) < 0.5
    for k in range(num):
        frame = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        frame[:, 2] *= np.linalg.det(frame)
        fold = np.radians(rng.uniform(1, 170)) / 2 * (1 if convex[k] else -1)
        along[k], level, up = frame.T
        for side, sign in enumerate((-1, 1)):
            across[side, k] = np.cos(fold) * level - sign * np.sin(fold) * up  # from the first side to the second
            normal = np.cos(fold) * up + sign * np.sin(fold) * level
            center = edge[k] + rng.uniform(-0.2, 0.2) * along[k] + sign * rng.uniform(0.05, 0.6) * across[side, k]
            turn = rng.uniform(0, 2 * np.pi)
            x = np.cos(turn) * along[k] + np.sin(turn) * across[side, k]
            rows.append((center, rng.uniform(0.7, 2) * x, rng.uniform(0.7, 2) * np.cross(normal, x)))
    return Splats(*map(np.array, zip(*rows, strict=True))), edge, along, across, convex


PAIRS = np.arange(400).reshape(-1, 2)


def test_each_side_of_an_edge_is_kept_by_one_of_its_two_splats():
    splats, edge, along, across, convex = roofs(200)
    for given in (None, convex):
        cut = clip_lines(splats, PAIRS, given)
        np.testing.assert_allclose(np.linalg.norm(cut.clip[:, 0, :2], axis=1), 1, atol=tol.FEATURE)
        assert not cut.clip[:, 1].any()
        for side in (0, 1):
            ids = PAIRS[:, side]
            for s in (-0.5, -1e-6, 1e-6, 0.5):
                point = edge + 0.1 * along + s * across[side]
                on_side = evaluate(cut.clip[ids, 0], disc_coordinates(cut, ids, point)) > 0
                np.testing.assert_array_equal(on_side, (s > 0) == bool(side))
    wrong = clip_lines(splats, PAIRS, ~convex)
    np.testing.assert_allclose(wrong.clip, -cut.clip, atol=tol.FEATURE)


def test_both_lines_are_one_line_in_space_and_in_the_image():
    splats = roofs(200)[0]
    cut = clip_lines(splats, PAIRS)
    camera = Camera.framing(cut.bounding_sphere, 20, 10, width=640, height=480)
    points = []
    for ids in PAIRS.T:
        a, b, c = cut.clip[ids, 0].T
        for t in (-0.5, 0.5):  # two points of the line, from disc coordinates to space
            u, v = -c * a - t * b, -c * b + t * a
            points.append(cut.center[ids] + u[:, None] * cut.tangent_u[ids] + v[:, None] * cut.tangent_v[ids])
    p, q, others = points[0], points[1], points[2:]
    for other in others:
        off = np.cross(other - p, q - p)
        np.testing.assert_allclose(np.linalg.norm(off, axis=1) / np.linalg.norm(q - p, axis=1), 0, atol=tol.FEATURE)
        first, second, third = (camera.project(x)[0] for x in (p, q, other))
        x, y = (second - first).T
        pixels = (x * (third - first)[:, 1] - y * (third - first)[:, 0]) / np.hypot(x, y)
        np.testing.assert_allclose(pixels, 0, atol=tol.FEATURE)


def test_coordinates_of_surveys_leave_the_lines_alone():
    splats = roofs(200)[0]
    far = Splats(splats.center + 2.0**22, splats.tangent_u, splats.tangent_v)
    # The centers themselves are rounded to 2^-31 there.
    np.testing.assert_allclose(clip_lines(far, PAIRS).clip, clip_lines(splats, PAIRS).clip, atol=2.0**-22)


def test_depth_of_a_cut_against_samples_of_the_disc():
    rng = np.random.default_rng(1)
    angle, offset = rng.uniform(0, 2 * np.pi, (300, 3)), rng.uniform(-0.9, 1.1, (300, 3))
    lines = np.stack([np.cos(angle), np.sin(angle), offset], axis=2)
    lines[:50, 1] = lines[:100, 2] = 0
    depth = cut_depth(lines[:, 0], lines[:, 1:])
    disc = np.sqrt(rng.random(20000)), rng.uniform(0, 2 * np.pi, 20000)
    rim = np.linspace(0, 2 * np.pi, 4000)
    inner = np.stack([disc[0] * np.cos(disc[1]), disc[0] * np.sin(disc[1])], axis=1)
    for k in range(300):
        chords = []
        for a, b, c in lines[k, 1:]:
            t = np.linspace(-1, 1, 4000)
            chords += [np.stack([-c * a - t * b, -c * b + t * a], axis=1)] if a or b else []
        points = np.concatenate([inner, np.stack([np.cos(rim), np.sin(rim)], axis=1), *chords])
        points = points[(points**2).sum(axis=1) <= 1 + 1e-12]
        points = points[(evaluate(lines[k, 1:, None], points) >= -1e-12).all(axis=0)]
        least = evaluate(lines[k, 0], points).min(initial=np.inf)
        assert depth[k] == least == np.inf or 0 <= least - depth[k] < tol.FEATURE_SAMPLED, (k, depth[k], least)


def test_the_two_lines_that_cut_deepest_are_kept_and_the_rest_is_counted():
    lines = normalize(np.array([[1, 0, 0.9], [0, 1, 0.2], [-1, 0, 0.4], [0, 1, 0.2], [1, 1, 3.0], [0, 0, 0]]))
    clip, lost = keep_deepest(np.zeros(6, int), lines, 2)
    np.testing.assert_array_equal(clip[0], lines[[1, 2]])
    assert not clip[1].any()
    np.testing.assert_array_equal(np.flatnonzero(lost), [0])  # not the copy, nor lines that cut nothing
    # A line outside the part that the other lines leave is no loss.
    corner = normalize(np.array([[1, 0, 0.5], [0, 1, 0.5], [1, 1, 1.05]]))
    assert not keep_deepest(np.zeros(3, int), corner, 1)[1].any()


def test_notes_name_the_cuts_that_are_dropped():
    axes = np.eye(3)
    floor = dict(center=np.zeros((1, 3)), tangent_u=axes[:1], tangent_v=axes[1:2])
    walls = [((1, 0, 0), 0.3), ((-1, 0, 0), 0.5), ((0, 1, 0), 0.7), ((0, 0, 1), 0.0)]
    rows = [(np.array(n) * d, np.roll(n, 1), np.cross(n, np.roll(n, 1))) for n, d in walls]
    center, u, v = (np.concatenate([floor[k], [r[i] for r in rows]]) for i, k in enumerate(floor))
    splats = Splats(center, u, v, notes=("before",))
    cut = clip_lines(splats, [(0, 1), (2, 0), (0, 3), (0, 4)], convex=True)
    np.testing.assert_allclose(cut.clip[0], [(-1, 0, 0.3), (1, 0, 0.5)], atol=tol.FEATURE)
    assert cut.notes == (
        "before",
        "cut 4 of 5 splats off along 4 edges",
        "dropped 1 clip lines of splats with two deeper ones",
        "1 pairs of splats are parallel and have no clip line",
    )
    # Given lines compete too; no part of the first splat is left.
    again = Splats(center, u, v, clip=np.where(np.arange(5)[:, None, None] == 0, [[0, -2, -4], [0, 0, 0]], 0.0))
    gone = clip_lines(again, [(0, 1)])
    np.testing.assert_allclose(gone.clip[0], [(0, -1, -2), (0, 0, 0)])
    assert gone.notes[-1] == "cut 1 splats off entirely"
    assert len(clip_lines(splats, [])) == 5 and not clip_lines(splats, []).clip.any()


@pytest.mark.parametrize(
    ("pairs", "message"),
    [
        ([(0, 24)], r"pair 0 has splats 0 and 24; they must be two of 24 \(0 to 23\)"),
        ([(0, 1), (3, 3)], "pair 1 has splats 3 and 3"),
        ([(0.0, 1.0)], r"pairs are float64 of shape \(1, 2\); they must be integers, \(P, 2\)"),
        ([1, 2], r"shape \(2,\)"),
    ],
)
def test_bad_pairs_are_errors(pairs, message):
    with pytest.raises(InvalidSplatsError, match=message):
        clip_lines(cube(), pairs)


def test_the_cube_is_covered_and_nothing_juts_out():
    center, size = np.array((3.0, -2.0, 5.0)), 0.8
    splats = cube(center, size)
    assert len(splats) == 24 and (np.linalg.norm(splats.clip[..., :2], axis=2) > 0).all()
    assert splats.notes == ("cut 24 of 24 splats off along 24 edges",)
    grid = np.linspace(-0.5, 0.5, 41)
    face = np.stack(np.meshgrid(grid, grid), axis=-1).reshape(-1, 2)
    wide = np.stack(np.meshgrid(np.linspace(-0.8, 0.8, 65), np.linspace(-0.8, 0.8, 65)), axis=-1).reshape(-1, 2)
    beyond = wide[(np.abs(wide) > 0.5 + tol.FEATURE_SPILL).any(axis=1)]
    for k in range(6):
        axis, sign = divmod(k, 2)
        ids = np.arange(4 * k, 4 * k + 4)
        np.testing.assert_allclose(splats.normal[ids], np.tile((2 * sign - 1) * np.eye(3)[axis], (4, 1)), atol=1e-15)
        for places, wanted in ((face * (1 - tol.FEATURE), True), (beyond, False)):
            points = center + size * np.insert(places, axis, sign - 0.5, axis=1)
            found = np.array([kept(splats, np.full(len(points), i), points) for i in ids]).any(axis=0)
            assert (found == wanted).all()


@pytest.mark.parametrize("azimuth", [0, 27])
def test_the_cubes_image_is_that_of_a_box(azimuth):
    splats = cube()
    camera = Camera.framing(splats.bounding_sphere, azimuth, 31, width=64, height=64)
    depth, front = cast(splats, camera)
    enter, leave = slabs(camera, -0.5, 0.5)
    exact, face = enter.max(axis=-1), enter.argmax(axis=-1)
    hit = exact < leave.min(axis=-1)
    assert 300 < hit.sum() < 3000
    np.testing.assert_array_equal(np.isfinite(depth), hit)
    np.testing.assert_allclose(depth[hit], exact[hit], rtol=tol.FEATURE)
    # All front splats of a pixel belong to the face that the pixel sees.
    np.testing.assert_array_equal(front[:, hit] // 8 == face[hit], front[:, hit] >= 0)


def test_a_cube_of_no_size_is_an_error():
    with pytest.raises(SettingsError, match=r"size must be positive and finite, not 0"):
        cube(size=0)
