"""The accounting: every render adds up exactly, and each check finds its own kind of error."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.agreement import scene
from helpers.groupings import SETTINGS, every_setting_and_grouping
from helpers.scenes import CAMERAS, EPSILON, VIEWS

import splatcl
from splatcl import RenderSettings
from splatcl.cli import FAILED, main
from splatcl.evidence import accounting, entries
from splatcl.evidence.accounting import Check, color_bound
from splatcl.frame import Frame
from splatcl.io.exr import read_exr
from splatcl.opencl.passes import bin as bin_pass

NAMES = ["splats", "binning", "fragments", "constant color", "repetition"]
VIEW = CAMERAS["outside"], RenderSettings(epsilon=EPSILON)


def failures(frame):
    checks = frame.check()
    assert [one.name for one in checks] == NAMES
    return [one.name for one in checks if not one.passed]


@pytest.mark.parametrize("precision", ["single", "double"])
@pytest.mark.parametrize(("scene_name", "camera_name"), VIEWS)
def test_every_scene_adds_up(renderer, scene_name, camera_name, precision):
    """Mutations: `x <` for `x <=` in FOR_EACH_TILE; `x + 1 < across` in add_small_boxes; no 64th splat in bin_count."""
    settings = RenderSettings(epsilon=EPSILON, precision=precision)
    assert failures(renderer.render(scene(scene_name), CAMERAS[camera_name], settings)) == []


@pytest.mark.parametrize(("settings", "lanes", "tile_size"), every_setting_and_grouping())
def test_every_setting_and_grouping_adds_up(renderer_with, settings, lanes, tile_size):
    settings = RenderSettings(**{"epsilon": EPSILON} | SETTINGS[settings])
    renderer = renderer_with(lanes=lanes, tile_size=tile_size)
    for camera_name in ("inside", "orthographic"):
        assert failures(renderer.render(scene("random_ellipses"), CAMERAS[camera_name], settings)) == []


def test_the_numbers_are_in_the_details_and_the_metadata(renderer):
    frame = renderer.render(scene("sphere"), VIEW[0], replace(VIEW[1], facing="cull"))
    checks = {one.name: one for one in frame.check()}
    assert frame.metadata["checks"] == {name: one.verdict for name, one in checks.items()}
    drawn, culled, beside = [int(word) for word in checks["splats"].detail.split() if word.isdigit()][:3]
    assert drawn + culled + beside == len(scene("sphere")) and min(drawn, culled) > 100
    total = int(frame["count"].sum())
    assert checks["fragments"].detail == f"{total} by pixel = {total} by splat"


def test_bands_of_tiles_add_up(renderer, monkeypatch):
    """Each band has one tile."""
    bands = bin_pass.bands
    monkeypatch.setattr(bin_pass, "bands", lambda totals, _: bands(totals, 1))
    assert failures(renderer.render(scene("layers"), *VIEW)) == []


def test_no_splats_add_up(renderer):
    assert failures(renderer.render(splatcl.Splats(*np.zeros((3, 0, 3))), *VIEW)) == []


# ---- constant color


@pytest.mark.parametrize("precision", ["single", "double"])
@pytest.mark.parametrize("settings", SETTINGS)
def test_a_power_of_two_comes_out_with_its_bits(renderer, settings, precision):
    """Each product w c is exact, so the sum of the products is exactly c times the sum of the weights.

    Mutation: color_sum * (1 / weight_sum) in place of the division.
    """
    settings = RenderSettings(**{"epsilon": EPSILON, "precision": precision} | SETTINGS[settings])
    splats = scene("random_ellipses")
    color = np.tile(np.array([1, 0.25, 64], np.float32), (len(splats), 1))
    frame = renderer.render(replace(splats, color=color), CAMERAS["off_center"], settings)
    covered = frame["weight"] > 0
    assert covered.sum() > 100
    assert (frame["albedo"][covered] == (1, 0.25, 64)).all() and not frame["albedo"][~covered].any()


@pytest.mark.parametrize("scene_name", ["random_ellipses", "layers", "sphere", "sub_pixel"])
@pytest.mark.parametrize("precision", ["single", "double"])
def test_any_constant_comes_out_to_within_the_bound(renderer, scene_name, precision):
    settings = RenderSettings(epsilon=100.0, precision=precision)
    splats, real = scene(scene_name), np.dtype({"single": "f4", "double": "f8"}[precision])
    constant = np.random.default_rng(0).uniform(1e-3, 1, 3).astype(real)
    frame = renderer.render(replace(splats, color=np.tile(constant, (len(splats), 1))), CAMERAS["outside"], settings)
    covered = frame["weight"] > 0
    error = np.abs(frame["albedo"][covered].astype(np.float64) / constant - 1)
    bound = color_bound(frame["count"][covered], frame["weight"][covered])
    assert (error <= bound[:, None]).all()
    assert (error > 0).any(), "float sums do not give every constant back"


def test_the_bound_is_about_two_roundings_a_fragment():
    bound = color_bound(np.array([1, 100], np.uint32), np.ones(2, np.float32))
    np.testing.assert_allclose(bound, np.array([3, 201]) * 2.0**-24, rtol=1e-4)


# ---- each check finds its own kind of error


def spoiled(monkeypatch, name, spoil):
    """Replace the result of the function `name` by `spoil(arguments, result)`."""
    for module in (accounting, entries):
        if original := getattr(module, name, None):
            monkeypatch.setattr(module, name, lambda *args, original=original: spoil(args, original(*args)))


def rewrite(device, buffer, shape, dtype, change):
    """Apply `change` to a buffer on the device, in place."""
    array = device.read(buffer, shape, dtype)
    change(array)
    device.write(buffer, array)


def test_a_lost_splat_is_seen(renderer, monkeypatch):
    frame = renderer.render(scene("sphere"), *VIEW)

    def lose_one(args, projected):
        def empty(boxes):
            boxes[np.argmax(boxes[:, 0] <= boxes[:, 2])] = (1, 0, 0, 0)

        rewrite(args[0].device, projected.boxes, (int(args[3].begin[-1]), 4), np.int16, empty)
        return projected

    spoiled(monkeypatch, "project", lose_one)
    assert "splats" in failures(frame)


def spoiled_lists(monkeypatch, change):
    """Apply `change` to the (N,) ids of the longest list of each band."""

    def spoil(args, bands):
        for lists in bands:
            run = int(np.argmax(np.diff(lists.begin)))
            own = slice(*(lists.start + lists.begin[run : run + 2]))
            rewrite(args[0].device, lists.ids, (own.stop,), np.int32, lambda ids, own=own: change(ids[own]))
            yield lists

    spoiled(monkeypatch, "bin", spoil)


@pytest.mark.parametrize("fault", ["twice", "swapped"])
def test_a_splat_twice_or_out_of_order_is_seen(renderer, monkeypatch, fault):
    frame = renderer.render(scene("sphere"), *VIEW)

    def change(ids):
        ids[:2] = ids[[0, 0]] if fault == "twice" else ids[[1, 0]]

    spoiled_lists(monkeypatch, change)
    assert "binning" in failures(frame)


def test_a_splat_that_a_list_lacks_is_seen(renderer, monkeypatch):
    frame = renderer.render(scene("sphere"), *VIEW)

    def name_the_next(ids):
        gap = np.flatnonzero(np.diff(ids) > 1)
        ids[gap] += 1

    spoiled_lists(monkeypatch, name_the_next)
    assert "binning" in failures(frame)


def test_another_record_in_a_tile_is_seen(renderer, monkeypatch):
    frame = renderer.render(scene("sphere"), *VIEW)

    def next_number(args, projected):
        passes, lists = args[0], args[3]

        def change(records):
            records["u_x"] = np.nextafter(records["u_x"], np.float32(np.inf))

        if lists.last_tile > 1:  # skip the projection of the one tile that holds all splats
            dtype = passes.dtypes["ProjectedSplat"]
            rewrite(passes.device, projected.records, (int(lists.begin[-1]),), dtype, change)
        return projected

    spoiled(monkeypatch, "project", next_number)
    assert "binning" in failures(frame)


def test_a_fragment_too_many_is_seen(renderer, monkeypatch):
    frame = renderer.render(scene("sphere"), *VIEW)

    def add_one(args, result):
        passes, gbuffer = args[0], args[-1]

        def one_more(count):
            count[7] += 1

        rewrite(passes.device, gbuffer.count, (passes.num_pixels,), np.uint32, one_more)

    spoiled(monkeypatch, "attributes", add_one)
    assert failures(frame) == ["fragments", "repetition"]


def test_a_color_off_by_one_bit_is_seen(renderer, monkeypatch):
    frame = renderer.render(scene("sphere"), *VIEW)

    def next_number(args, result):
        passes, gbuffer = args[0], args[-1]

        def change(sums):
            pixel = int(np.argmax(sums[:, 0]))
            sums[pixel, 0] = np.nextafter(sums[pixel, 0], np.inf)

        rewrite(passes.device, gbuffer.color_sum, (passes.num_pixels, 3), passes.real, change)

    spoiled(monkeypatch, "attributes", next_number)
    assert failures(frame) == ["constant color"]


def test_another_image_is_seen(renderer):
    frame = renderer.render(scene("sphere"), *VIEW)
    weight = frame["weight"].copy()
    weight[18, 24] = np.nextafter(weight[18, 24], np.inf)
    changed = Frame({**dict(frame), "weight": weight}, *VIEW)
    changed.rendered_from = frame.rendered_from
    assert failures(changed) == ["repetition"]


# ---- the command line


@pytest.fixture
def command(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    splatcl.write(scene("sphere"), "scan.npz")
    return ["render", "scan.npz", "-o", "out.exr", "--size", "32x24", "--check"]


def test_the_command_prints_a_line_a_check_and_records_them(command, capsys):
    assert main(command) == 0
    lines = [line for line in capsys.readouterr().out.splitlines() if line.startswith("check ")]
    recorded = read_exr("out.exr")[2]["checks"]
    assert sorted(recorded) == sorted(NAMES)
    assert lines == [f"check {name:<15} {recorded[name]}" for name in NAMES]
    assert all(verdict.startswith("passed: ") for verdict in recorded.values())


def test_the_command_exits_1_if_a_check_fails(command, capsys, monkeypatch, tmp_path):
    checks = (Check("splats", True, "2 = 2"), Check("fragments", False, "3 by pixel but 4 by splat"))
    monkeypatch.setattr(Frame, "check", lambda self: checks)
    assert main(command) == FAILED
    captured = capsys.readouterr()
    assert "check fragments       FAILED: 3 by pixel but 4 by splat" in captured.out.splitlines()
    assert captured.err.splitlines()[-1].startswith(
        "splatcl: error: fragments: the check failed; do not trust this image"
    )
    assert (tmp_path / "out.exr").exists(), "to be looked at"
