"""The bin pass: each tile's list holds the splats whose bounds reach the tile, and few others, in splat order."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.agreement import scene
from helpers.device_passes import DevicePasses
from helpers.scenes import CAMERAS, EPSILON, EYE, any_camera, any_discs

from splatcl import Camera, RenderSettings
from splatcl.opencl.passes import bin as bin_pass

SETTINGS = RenderSettings(epsilon=EPSILON)
TILES = [8, 16, 32, 64]
MOST_IDLE = 0.5
"""Largest share of the entries that reach no pixel of their tile."""


def bands_of(max_records):
    """Return `bin_pass.bands` with a lower limit, which gives several bands of tiles even for a few splats."""
    bands = bin_pass.bands
    return lambda totals, limit: bands(totals, min(limit, max_records))


def brute_force(records, camera, tile_size):
    """Return, for each tile in row-major order, the places in `records` whose bounds overlap the tile's pixels."""
    places = []
    for y in range(0, camera.height, tile_size):
        for x in range(0, camera.width, tile_size):
            inside_x = (records["x_min"] < x + tile_size) & (records["x_max"] >= x)
            inside_y = (records["y_min"] < y + tile_size) & (records["y_max"] >= y)
            places.append(np.flatnonzero(inside_x & inside_y))
    return places


@pytest.mark.parametrize("max_records", [1, 100, 8 << 20])
@pytest.mark.parametrize("tile_size", TILES)
@pytest.mark.parametrize("scene_name", ["random_ellipses", "giant", "near_plane", "sub_pixel"])
def test_runs_equal_brute_force(device, monkeypatch, scene_name, tile_size, max_records):
    monkeypatch.setattr(bin_pass, "bands", bands_of(max_records))
    monkeypatch.setattr(bin_pass, "MIN_CHUNK", 16)  # several chunks, of which the last is not full
    camera = Camera.look_at(EYE, (0, 0, 0), near=0.125, width=150, height=91)
    passes = DevicePasses(device, scene(scene_name), camera, SETTINGS, tile_size)
    records, attributes = passes.project()
    runs, bands = passes.bin()
    expected = brute_force(records, camera, tile_size)
    assert len(runs) == len(expected) and sum(len(places) for places in expected) > 0
    num_idle = 0
    for run, places in zip(runs, expected, strict=True):
        assert (np.diff(run.records["id"].astype(np.int64)) > 0).all()
        reaching = np.isin(run.records["id"], records["id"][places])
        np.testing.assert_array_equal(run.records[reaching], records[places])
        np.testing.assert_array_equal(run.attributes[reaching], attributes[places])
        num_idle += np.count_nonzero(~reaching)
    assert num_idle <= MOST_IDLE * sum(len(run.records) for run in runs)
    assert [first for first, _ in bands] == [0] + [last for _, last in bands[:-1]]
    assert bands[-1][1] == len(runs)
    num_entries = sum(len(run.records) for run in runs)
    assert (len(bands) == 1) == (num_entries <= max_records)


@pytest.mark.parametrize("min_chunk", [1, 48, 1024])
def test_chunks_do_not_change_the_records(device, monkeypatch, min_chunk):
    whole = DevicePasses(device, scene("sub_pixel"), CAMERAS["outside"], SETTINGS).project()
    monkeypatch.setattr(bin_pass, "MIN_CHUNK", min_chunk)
    monkeypatch.setattr(bin_pass, "MAX_CHUNKS", 10000)
    cut = DevicePasses(device, scene("sub_pixel"), CAMERAS["outside"], SETTINGS).project()
    for a, b in zip(whole, cut, strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("totals", [[0], [5], [0, 0, 0], [3, 3, 3, 3], [9, 0, 0, 1], [0, 9, 9, 0], [1] * 20])
@pytest.mark.parametrize("max_records", [1, 3, 4, 9, 100])
def test_bands_cut_the_tiles_once(totals, max_records):
    cuts = list(bin_pass.bands(np.array(totals, np.int32), max_records))
    tiles = [tile for first, last in cuts for tile in range(first, last)]
    assert tiles == list(range(len(totals)))
    for first, last in cuts:
        assert sum(totals[first:last]) <= max_records or last == first + 1


def test_bands_count_beyond_32_bits():
    totals = np.full(4, 2**30, np.int32)
    assert list(bin_pass.bands(totals, 2**31)) == [(0, 2), (2, 4)]


@pytest.mark.parametrize("max_records", [1, 50, 500])
@pytest.mark.parametrize("size", [(61, 47), (1, 1), (16, 16), (17, 1), (1, 33)])
def test_bands_do_not_change_the_image(renderer, monkeypatch, size, max_records):
    camera = Camera.look_at((0, 0, 3), (0, 0, 0), width=size[0], height=size[1])
    whole = dict(renderer.render(scene("random_ellipses"), camera, SETTINGS))
    monkeypatch.setattr(bin_pass, "bands", bands_of(max_records))
    cut = dict(renderer.render(scene("random_ellipses"), camera, SETTINGS))
    for name, array in whole.items():
        assert array.tobytes() == cut[name].tobytes(), name


@pytest.mark.parametrize("precision", ["single", "double"])
@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_no_list_lacks_a_splat(device, projection, precision):
    """Mutations: PIXEL_SLACK, NEAR_SLACK or CENTER_SLACK negative; TILT_SLACK halved, or times the smaller side."""
    num_drawn = 0
    for seed in range(100):
        rng = np.random.default_rng(seed)
        camera = any_camera(rng, projection)
        settings = RenderSettings(
            epsilon=0.0,
            precision=precision,
            facing=str(rng.choice(["keep", "cull", "flip"])),
            prefilter=str(rng.choice(["min", "none"])),
            prefilter_radius=float(10.0 ** rng.uniform(-1, 1.5)),
            prefilter_center=str(rng.choice(["projected", "bounds"])),
        )
        passes = DevicePasses(device, any_discs(rng, camera), camera, settings)
        records, _ = passes.project()
        for run, places in zip(passes.bin()[0], brute_force(records, camera, 16), strict=True):
            assert np.isin(records["id"][places], run.records["id"]).all(), seed
        num_drawn += len(records)
    assert num_drawn > 5000
