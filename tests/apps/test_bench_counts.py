"""The benchmark's counts of lanes, entries and fragments."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import splatcl
from splatcl.apps import sample_scenes
from splatcl.apps.bench import measure
from splatcl.apps.bench.matrix import BASE, Row
from splatcl.apps.bench.measure import Job
from splatcl.apps.bench.passes import PASSES, FramePasses, lanes_of


def test_lanes_of_large_boxes():
    boxes = np.array([(0, 0, 4, 1), (3, 1, 4, 2), (10, 0, 20, 0), (10, 0, 20, 0)], np.int16)
    tile = np.array([0, 0, 0, 1])  # the last two boxes are one splat in both tiles that it touches
    # 4x2 blocks from the corner of each box: 2x1, 1x1, 2x1; 2x1
    assert lanes_of(boxes, tile, 2, 16, 8) == 8 * (2 + 1 + 2 + 2)
    assert lanes_of(boxes, tile, 2, 16, 4) == 4 * (3 + 1 + 3 + 3)  # 2x2 blocks
    assert lanes_of(boxes, tile, 2, 16, 1) == 10 + 4 + 6 + 5


def test_lanes_of_small_boxes():
    boxes = np.array([(1, 1, 3, 1)] * 5 + [(4, 4, 4, 7), (14, 0, 17, 0), (20, 2, 22, 2), (16, 0, 20, 0)], np.int16)
    tile = np.array([0] * 7 + [1, 1])
    # One vector takes each of 3x1 positions, then each of 3x4; the box of 14 to 17 has 2 columns in its tile. A batch
    # with a box of 5 columns runs box by box.
    assert lanes_of(boxes, tile, 2, 16, 4) == 4 * (3 + 12 + (2 + 3))
    assert lanes_of(boxes[:7], tile[:7], 2, 16, 8) == 8 * 12
    nowhere = np.array([(1, 0, 0, 5), (16, 0, 17, 0)], np.int16)
    assert lanes_of(nowhere, np.array([0, 0]), 2, 16, 8) == lanes_of(nowhere[:0], tile[:0], 2, 16, 8) == 0


def facing_discs(rows, size):
    """Return discs parallel to the image of an orthographic camera: x, y and radius in pixels, z, 1 or -1."""
    camera = splatcl.Camera(np.eye(4), size / 2, size / 2, size / 2, size / 2, size, size, projection="orthographic")
    x, y, radius, z, side = np.array(rows, np.float64).T
    none, radius = np.zeros_like(x), radius * 2 / size
    center = np.stack([x * 2 / size - 1, y * 2 / size - 1, z], axis=1)
    u, v = np.stack([radius, none, none], axis=1), np.stack([none, -radius * side, none], axis=1)
    return camera, splatcl.Splats(center, u, v)


def test_counts_of_a_frame_by_hand(renderer):
    """The scene has three facing discs of radius 4.5 pixels: within a tile, over four tiles, and one back face."""
    camera, splats = facing_discs([(8, 8, 4.5, 32, 1), (16, 16, 4.5, 32, 1), (24, 24, 4.5, 32, -1)], 32)
    resident = renderer.upload(splats)
    settings = splatcl.RenderSettings(facing="cull", epsilon=0.0)
    counts = FramePasses(renderer, resident, camera, settings).counts()
    assert (counts.num_splats, counts.num_listed, counts.num_entries) == (3, 2, 5)
    assert (counts.num_discs, counts.num_near) == (5, 5)
    assert counts.num_pixels == 1024 and counts.real_bytes == 4
    assert counts.num_projected == 5
    assert (counts.plane_bytes, counts.touched_bytes, counts.entry_bytes, counts.splat_bytes) == (36, 16, 4, 48)
    assert (counts.record_bytes, counts.attribute_bytes) == (64, 32)
    y, x = np.mgrid[:32, :32] + 0.5
    hits = sum(int(((x - c) ** 2 + (y - c) ** 2 <= 4.5**2).sum()) for c in (8, 16))
    fragments = measure.count_fragments(renderer, resident, camera, settings)
    assert fragments.hits == fragments.drawn.fragments == fragments.without_prefilter.fragments == hits
    assert fragments.drawn.pixels <= hits
    # The blocks of one 10x10 box and of four 5x5 boxes.
    num_blocks = {1: 100 + 4 * 25, 4: 25 + 4 * 9, 8: 15 + 4 * 6, 16: 9 + 4 * 4}[renderer.device.lanes]
    assert counts.visibility_lanes == counts.attribute_lanes == num_blocks * renderer.device.lanes


def test_what_lies_behind_is_not_taken(renderer):
    """One disc covers the image before two hidden discs, of which one lies half outside the image.

    Without back-face culling, the hidden discs are not even projected.
    """
    camera, splats = facing_discs([(8, 8, 2, 9, 1), (8, 8, 40, 2, 1), (16, 8, 3, 9, 1)], 16)
    settings = splatcl.RenderSettings(epsilon=0.0, facing="cull")
    counts = FramePasses(renderer, renderer.upload(splats), camera, settings).counts()
    assert (counts.num_listed, counts.num_entries, counts.num_projected) == (3, 3, 3)
    assert (counts.num_discs, counts.num_near) == (3, 1)
    assert 256 <= counts.attribute_lanes < counts.visibility_lanes
    kept = FramePasses(renderer, renderer.upload(splats), camera, replace(settings, facing="keep")).counts()
    assert (kept.num_listed, kept.num_entries, kept.num_projected) == (3, 3, 1)
    assert (kept.num_discs, kept.num_near, kept.attribute_lanes) == (1, 1, counts.attribute_lanes)
    assert kept.visibility_lanes == kept.attribute_lanes


def test_counts_agree_with_each_other(renderer):
    row = Row(2000, replace(BASE, facing="keep"), width=64, height=48)
    job = Job(renderer, renderer.upload(sample_scenes.fibonacci_sphere(2000)), row)
    counts = job.counts
    assert counts.num_listed == 2000 <= counts.num_entries
    assert 0 < counts.num_near <= counts.num_entries and 0 < counts.num_discs <= counts.num_entries
    assert counts.attribute_lanes >= job.fragments.drawn.fragments and counts.visibility_lanes >= job.fragments.hits
    fragments = job.fragments
    assert fragments.drawn == fragments.with_prefilter
    assert fragments.drawn.fragments > fragments.without_prefilter.fragments
    assert fragments.hits > 1.5 * fragments.without_prefilter.fragments  # the back side's hits count too
    times = job.times()
    assert list(times) == ["frame", *PASSES] and min(times.values()) > 0
