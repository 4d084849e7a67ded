"""The probe: its numbers are the kernels' own, and its verdict on each splat is true."""

from __future__ import annotations

import json
import multiprocessing
import pickle
import re
from dataclasses import replace

import numpy as np
import pytest
from helpers.agreement import scene
from helpers.groupings import SETTINGS, every_setting_and_grouping
from helpers.paths import ROOT
from helpers.scenes import CAMERAS, EPSILON, VIEWS
from tolerances import DEPTH_BY_HAND, PROBED_DISC

import splatcl
from splatcl import Camera, RenderSettings, SplatclError, Splats
from splatcl.cli import MISTAKE, main
from splatcl.evidence.host import margin as host_margin
from splatcl.evidence.host import pairs
from splatcl.evidence.probe_report import COLUMNS, REACH
from splatcl.frame import Frame

FLAT = Camera.look_at((0, 0, 3), (0, 0, 0), width=8, height=8, near=1, far=10)
"""Camera whose pixel (4, 4) looks at (s, -s, 0); s = HALF_PIXEL is half a pixel in the plane z = 0."""
HALF_PIXEL = 1.5 / FLAT.fx


def pixels(frame, num, seed=0):
    """Return some pixels of the frame, most of them covered, as (x, y)."""
    rng = np.random.default_rng(seed)
    covered = np.argwhere(frame["count"] > 0)
    chosen = covered[rng.integers(len(covered), size=num)] if len(covered) else covered
    return [(int(x), int(y)) for y, x in [*chosen, *rng.integers((frame.height, frame.width), size=(num // 4, 2))]]


def facing_disc(center, radius, flipped=False):
    """Return c, t_u, t_v of a disc in a plane of constant z; its normal is +z, or -z if flipped."""
    return center, (radius, 0, 0), (0, -radius if flipped else radius, 0)


def splats_of(*discs):
    center, t_u, t_v = (np.array(column, np.float32) for column in zip(*discs, strict=True))
    color = np.linspace(0.1, 0.9, 3 * len(discs)).reshape(-1, 3).astype(np.float32)
    return Splats(center, t_u, t_v, color=color)


def assert_ends_at_the_frame(frame, probe):
    """Assert that the running sums, depth(p) and its splat equal the frame's, bit for bit."""
    x, y = probe.x, probe.y
    assert (probe.depth, probe.particleid) == (frame["Z"][y, x], frame["particleid"][y, x])
    assert (probe.weight, probe.count) == (frame["weight"][y, x], frame["count"][y, x])
    ids = [row.splat for row in probe.rows]
    assert ids == sorted(set(ids))
    assert probe.count == sum(row.accepted for row in probe.rows)
    if not probe.rows:
        assert probe.count == 0
        return
    sums = probe.rows[-1].sums
    assert (sums.weight, sums.count) == (probe.weight, probe.count)
    if probe.weight:
        real = frame["weight"].dtype.type
        assert tuple(real(c) / real(sums.weight) for c in sums.color) == probe.albedo


@pytest.mark.parametrize("precision", ["single", "double"])
@pytest.mark.parametrize(("scene_name", "camera_name"), VIEWS)
def test_the_sums_end_at_the_frame_s_bits(renderer, scene_name, camera_name, precision):
    """Mutations in probe_rows: epsilon 0 in farthest_accepted; no pre-filter in contribution_at; entries in reverse."""
    frame = renderer.render(
        scene(scene_name), CAMERAS[camera_name], RenderSettings(epsilon=EPSILON, precision=precision)
    )
    for x, y in pixels(frame, 8):
        assert_ends_at_the_frame(frame, frame.probe(x, y))


@pytest.mark.parametrize(("settings", "lanes", "tile_size"), every_setting_and_grouping())
def test_so_they_do_for_every_setting_and_grouping(renderer_with, settings, lanes, tile_size):
    settings = RenderSettings(**{"epsilon": EPSILON} | SETTINGS[settings])
    for camera_name in ("off_center", "orthographic"):
        renderer = renderer_with(lanes=lanes, tile_size=tile_size)
        frame = renderer.render(scene("random_ellipses"), CAMERAS[camera_name], settings)
        for x, y in pixels(frame, 8):
            assert_ends_at_the_frame(frame, frame.probe(x, y))


def test_so_they_do_for_many_chunks_of_splats(renderer):
    """The device projects 5000 splats in five chunks; the rows keep the splat order across the chunks.

    Mutation: `place = 0` for `place = begin` in probe_select.
    """
    rng = np.random.default_rng(0)
    center = rng.uniform(-1, 1, (5000, 3)) * (1, 1, 0.05)
    splats = Splats(center, np.tile([0.1, 0, 0], (5000, 1)), np.tile([0, 0.1, 0], (5000, 1)))
    frame = renderer.render(renderer.upload(splats), CAMERAS["outside"], RenderSettings(epsilon=EPSILON))
    for x, y in pixels(frame, 4)[:4]:
        probe = frame.probe(x, y)
        assert_ends_at_the_frame(frame, probe)
        assert probe.count > 3 and probe.rows[-1].splat - probe.rows[0].splat > 3000


@pytest.mark.parametrize("camera_name", ["outside", "off_center", "orthographic"])
def test_the_rows_are_all_that_is_within_reach(renderer, camera_name):
    """u, v and z solve c + u t_u + v t_v = z d, and every splat within reach has a row.

    Mutation: reach 1 in probe_select.
    """
    splats, camera = scene("sphere"), CAMERAS[camera_name]
    frame = renderer.render(splats, camera, RenderSettings(epsilon=EPSILON, prefilter="none"))
    rotation, translation = camera.eye_from_world[:3, :3], camera.eye_from_world[:3, 3]
    c = splats.center @ rotation.T + translation
    t = np.stack([splats.tangent_u @ rotation.T, splats.tangent_v @ rotation.T], axis=-1)
    for x, y in pixels(frame, 8):
        s = np.array([(x + 0.5 - camera.cx) / camera.fx, (y + 0.5 - camera.cy) / camera.fy, 1.0])
        orthographic = camera.projection == "orthographic"
        start, d = (s * (1, 1, 0), np.array([0.0, 0, 1])) if orthographic else (np.zeros(3), s)
        systems = np.concatenate([t, np.broadcast_to(-d[:, None], (len(c), 3, 1))], axis=2)
        u, v, z = np.linalg.solve(systems, (start - c)[..., None])[..., 0].T
        within = np.flatnonzero((np.hypot(u, v) <= REACH - 1e-3) & (z > 0))
        rows = {row.splat: row for row in frame.probe(x, y).rows if row.verdict != "edge-on"}
        assert set(within) <= set(rows)
        for i, row in rows.items():
            if not np.isfinite(row.r3d) or row.r3d > REACH:
                continue
            np.testing.assert_allclose([row.u, row.v, row.r3d, row.z], [u[i], v[i], np.hypot(u[i], v[i]), z[i]],
                                       rtol=PROBED_DISC, atol=PROBED_DISC)  # fmt: skip


def test_each_verdict_by_hand(renderer):
    """Mutations: `_projections` without the one for culling, or without the one for near and far."""
    s, tiny = HALF_PIXEL, 1e-4
    front, behind = (1.25 * s, -s, 0), (s * 4 / 3, -s * 4 / 3, -1)
    splats = splats_of(
        facing_disc(behind, 1.0),  # 0: one unit behind
        facing_disc(front, s),  # 1: its hit is at u = -1/4
        facing_disc((s, -s, 0), 0.5, flipped=True),  # 2: its back faces the eye
        facing_disc((1.5 * s, -s, 0), tiny),  # 3: too small to be hit, a quarter of a pixel off
        facing_disc((2.1 * s, -s, 0), s),  # 4: r3 is 1.1, r2 is 0.55
        facing_disc((0, 0, 2.5), 0.2),  # 5: in front of near
        facing_disc((0, 0, -8), 9.0),  # 6: beyond far
        ((s, -s, 0.001), (0, 0, 0.01), (s + 1e-5, -s + 1e-5, -3.001)),  # 7: edge-on, its front by 3e-4 degrees
        facing_disc((4.2 * s, -s, 0), 2.8 * s),  # 8: r3 is 1.14, r2 is 1.6
    )
    settings = RenderSettings(epsilon=0.01, facing="cull")
    frame = renderer.render(splats, FLAT, settings)
    rows = {row.splat: row for row in frame.probe(4, 4).rows}
    assert {i: row.verdict for i, row in rows.items()} == {
        0: "behind depth + epsilon",
        1: "disc",
        2: "culled",
        3: "pre-filter",
        4: "pre-filter",
        5: "out of near..far",
        6: "out of near..far",
        7: "pre-filter",
        8: "missed",
    }
    row = rows[1]
    assert (row.u, row.v) == pytest.approx((-0.25, 0), abs=DEPTH_BY_HAND)
    assert (row.r3d, row.r2d, row.z) == pytest.approx((0.25, 0.125, 3), rel=DEPTH_BY_HAND, abs=1e-6)
    assert row.weight == pytest.approx(np.exp(-2 * 0.125**2), rel=1e-5)
    assert rows[3].weight == pytest.approx(np.exp(-2 * 0.25**2), rel=1e-5)
    assert rows[0].weight > 0 and rows[0].sums.weight == 0
    assert rows[2].weight == 0 and rows[2].sums == rows[1].sums
    assert rows[5].sums == rows[6].sums == rows[4].sums
    bare = {row.splat: row.verdict for row in frame_without_prefilter(renderer, splats, settings).probe(4, 4).rows}
    assert bare[3] == "missed" and bare[4] == "missed" and bare[7] == "edge-on"


def frame_without_prefilter(renderer, splats, settings):
    return renderer.render(splats, FLAT, replace(settings, prefilter="none"))


@pytest.mark.parametrize("scene_name", ["layers", "sphere", "near_plane", "giant"])
def test_the_least_margin_is_the_pixel_s(renderer, scene_name):
    """Mutation: `_margins` of each row alone, without the splats in front of it."""
    splats, camera, settings = scene(scene_name), CAMERAS["outside"], RenderSettings(epsilon=EPSILON)
    frame = renderer.render(splats, camera, settings)
    margin, _ = host_margin.margin(splats, camera, settings, EPSILON)
    nearly_tied = np.argwhere(margin < pairs.MAX_MARGIN)
    assert len(nearly_tied) >= 4
    for y, x in nearly_tied[:20].tolist():
        probe = frame.probe(x, y)
        assert probe.margin == min(row.margin for row in probe.rows)
        assert np.float32(probe.margin) == pytest.approx(margin[y, x], rel=1e-6)


def test_an_empty_pixel(renderer):
    probe = renderer.render(splats_of(facing_disc((0, 0, 0), 0.01)), FLAT).probe(0, 0)
    assert probe.rows == () and probe.depth == np.inf and probe.count == 0
    assert "depth(p)  inf (no disc is hit)" in str(probe) and "<table>" in probe._repr_html_()
    assert json.loads(probe.to_json())["depth"] is None


def test_a_render_of_no_splats(renderer):
    assert renderer.render(Splats(*np.zeros((3, 0, 3))), FLAT).probe(0, 0).rows == ()


def test_the_table_is_aligned_and_holds_every_row(renderer):
    frame = renderer.render(scene("layers"), CAMERAS["outside"], RenderSettings(epsilon=EPSILON))
    probe = frame.probe(*pixels(frame, 1)[0])
    lines = str(probe).splitlines()
    head = next(i for i, line in enumerate(lines) if line.split() == list(COLUMNS))
    table = lines[head : head + len(probe.rows) + 1]
    ends = {line.index(line.split(maxsplit=len(COLUMNS) - 1)[-1]) for line in table}
    assert len(ends) == 1, "verdicts start in one column"
    assert [int(line.split()[0]) for line in table[1:]] == [row.splat for row in probe.rows]
    assert probe._repr_html_().count("<tr>") == len(probe.rows) + 1


def test_json_holds_every_bit(renderer):
    frame = renderer.render(scene("layers"), CAMERAS["outside"], RenderSettings(epsilon=EPSILON))
    probe = frame.probe(*pixels(frame, 1)[0])
    record = json.loads(probe.to_json(), parse_constant=lambda name: pytest.fail(f"{name} is not JSON"))
    assert [row["weight"] for row in record["rows"]] == [row.weight for row in probe.rows]
    assert record["rows"][-1]["sums"]["weight"] == record["weight"] == frame["weight"][probe.y, probe.x]


@pytest.mark.parametrize("pixel", [(-1, 0), (0, -1), (8, 0), (0, 8)])
def test_a_pixel_outside_the_image_is_one_line(renderer, pixel):
    frame = renderer.render(splats_of(facing_disc((0, 0, 0), 0.5)), FLAT)
    with pytest.raises(SplatclError, match=r"is outside the image: x is 0 to 7, y is 0 to 7$"):
        frame.probe(*pixel)


def test_a_frame_without_its_splats_is_one_line(renderer):
    frame = renderer.render(splats_of(facing_disc((0, 0, 0), 0.5)), FLAT)
    for other in (pickle.loads(pickle.dumps(frame)), Frame(dict(frame), FLAT, RenderSettings())):
        with pytest.raises(SplatclError, match=r"^cannot probe a frame without its splats"):
            other.probe(4, 4)


def _probe_in_child(splats, connection):
    renderer = splatcl.Renderer()
    frame = renderer.render(renderer.upload(splats), FLAT)
    connection.send(frame.probe(4, 4))


def test_a_forked_process_probes_too(renderer):
    splats = splats_of(facing_disc((0, 0, 0), 0.5))
    here = renderer.render(splats, FLAT).probe(4, 4)
    context = multiprocessing.get_context("fork")
    receiver, sender = context.Pipe(duplex=False)
    child = context.Process(target=_probe_in_child, args=(splats, sender))
    child.start()
    assert receiver.poll(60) and receiver.recv() == here
    child.join(60)


# ---- the command line


@pytest.fixture
def scan(tmp_path):
    path = tmp_path / "scan.npz"
    splatcl.write(scene("sphere"), path)
    return path


OPTIONS = ["--size", "32x24", "--azimuth", "30", "--epsilon", "0.1", "--cutoff", "1"]


def test_the_command_prints_what_the_frame_says(scan, capsys, renderer):
    settings = RenderSettings(epsilon=0.1, cutoff=1)
    camera = Camera.framing(scene("sphere").bounding_sphere, azimuth=30, width=32, height=24)
    probe = renderer.render(scene("sphere"), camera, settings).probe(15, 11)
    assert main(["probe", str(scan), "15", "11", *OPTIONS]) == 0
    assert capsys.readouterr().out == f"{probe}\n"
    assert main(["probe", str(scan), "15", "11", "--json", *OPTIONS]) == 0
    assert json.loads(capsys.readouterr().out) == json.loads(probe.to_json())


@pytest.mark.parametrize("pixel", [("32", "0"), ("0", "-1")])
def test_the_command_refuses_a_pixel_outside(scan, capsys, pixel):
    assert main(["probe", str(scan), *pixel, *OPTIONS]) == MISTAKE
    captured = capsys.readouterr()
    assert captured.out == "" and "error: pixel (" in captured.err.splitlines()[-1]


def test_the_documentation_shows_what_is_printed(capsys, tmp_path, monkeypatch):
    """Both examples of docs/trust/probe.md are current, word for word. Their file has splats: no estimates."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "reference_images").symlink_to(ROOT / "reference_images")
    examples = re.findall(
        r"```console\n\$ splatcl (.*)\n([^`]*)```", (ROOT / "docs" / "trust" / "probe.md").read_text()
    )
    assert len(examples) == 2
    for command, output in examples:
        assert main(command.split()) == 0
        printed = capsys.readouterr().out
        lines = printed.splitlines() if command.startswith("probe") else re.findall("^check .*", printed, re.MULTILINE)
        assert lines == output.splitlines()
