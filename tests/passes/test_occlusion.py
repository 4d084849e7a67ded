"""Occlusion culling: splats behind a tile's front layer are not projected, and no bit of the image changes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.agreement import scene
from helpers.device_passes import DevicePasses
from helpers.scenes import CAMERAS, EPSILON, VIEWS, any_camera, any_discs

from splatcl import RenderSettings
from splatcl.opencl.passes import bin as bin_pass
from splatcl.opencl.state.context import EVERY

TILES = [8, 32, 64]
USUAL = (16, "raycast", "min", False)
WAYS = (  # tile size, footprint, pre-filter, and whether clip lines are given; few, because each compiles programs
    (8, "raycast", "min", False),
    USUAL,
    (32, "raycast", "none", False),
    (64, "raycast", "min", False),
    (16, "raycast", "min", True),
    (8, "conic", "ewa", False),
    (32, "affine", "min", True),
    (64, "conic", "none", False),
)
DISCS = WAYS[:4]


def in_ways(ways, usual=(USUAL,)):
    """Parametrize `ways`: the usual way, and as a slow test all `ways`, because each compiles programs."""
    return pytest.mark.parametrize("ways", [usual, pytest.param(ways, marks=pytest.mark.slow)], ids=["usual", "all"])


def any_settings(rng, precision, footprint, prefilter):
    """Return random settings with which the projection uses layers."""
    return RenderSettings(
        epsilon=float(rng.choice([0.0, 10.0 ** rng.uniform(-6, 4)])),
        precision=precision,
        facing=str(rng.choice(["keep", "flip"])),
        along=str(rng.choice(["z", "ray"])),
        footprint=footprint,
        prefilter=prefilter,
        prefilter_radius=float(10.0 ** rng.uniform(-1, 1.5)),
        prefilter_center=str(rng.choice(["projected", "bounds"])),
    )


def sums(device, splats, camera, settings, tile_size, layers=None):
    """Return the outputs of the passes up to the attribute pass, drawn in `layers` if given."""
    passes = DevicePasses(device, splats, camera, settings, tile_size)
    passes.passes.layers = layers or passes.passes.layers
    return passes.raster()


def assert_layers_do_not_show(device, splats, camera, settings, tile_size):
    whole = sums(device, splats, camera, settings, tile_size, (EVERY,))
    for name, array in sums(device, splats, camera, settings, tile_size).items():
        assert array.tobytes() == whole[name].tobytes(), name


@in_ways(TILES, usual=[16])
@pytest.mark.parametrize("precision", ["single", "double"])
@pytest.mark.parametrize("thickness", [0, bin_pass.FRONT_THICKNESS])
@pytest.mark.parametrize(("scene_name", "camera_name"), VIEWS)
def test_layers_do_not_change_the_sums(device, monkeypatch, scene_name, camera_name, thickness, precision, ways):
    monkeypatch.setattr(bin_pass, "FRONT_THICKNESS", thickness)
    settings = RenderSettings(epsilon=EPSILON, precision=precision)
    tile_size = ways[VIEWS.index((scene_name, camera_name)) % len(ways)]
    assert_layers_do_not_show(device, scene(scene_name), CAMERAS[camera_name], settings, tile_size)


@in_ways(WAYS)
@pytest.mark.parametrize("precision", ["single", "double"])
@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_layers_of_any_discs_do_not_change_the_sums(device, monkeypatch, projection, precision, ways):
    """Mutation: no epsilon in occluders_of."""
    monkeypatch.setattr(bin_pass, "FRONT_THICKNESS", 0)
    for seed in range(60):
        rng = np.random.default_rng(seed)
        camera = any_camera(rng, projection)
        tile_size, footprint, prefilter, has_lines = ways[seed % len(ways)]
        splats, settings = any_discs(rng, camera), any_settings(rng, precision, footprint, prefilter)
        if has_lines:
            lines = np.array([0, 0, 0.5]) + rng.normal(size=(len(splats), 2, 3))
            splats = replace(splats, clip=lines, on_invalid="error")
        assert_layers_do_not_show(device, splats, camera, settings, tile_size)


@pytest.fixture
def no_front(monkeypatch):
    """Give every entry of the tile lists its depth in the occlusion key, with no front layer."""
    monkeypatch.setattr(bin_pass, "FRONT_THICKNESS", -1e30)


def read_keys(passes, tile_size):
    """Yield each tile's first pixel, its records, their attributes and their occlusion keys."""
    device, own = passes.device, passes.passes
    for lists in bin_pass.bin(own, passes.view, passes.splats):
        keys = device.read(lists.keys, (lists.start + lists.begin[-1],), np.int32)[lists.start :]
        records, attributes = passes.read(lists)
        for k in range(lists.last_tile - lists.first_tile):
            run = slice(*lists.begin[k : k + 2])
            y, x = divmod(lists.first_tile + k, own.tiles_x)
            yield x * tile_size, y * tile_size, records[run], attributes[run], keys[run]


def fragments_of(records, attributes, x, y, settings, projection):
    """Return (N, P) whether N records have fragments at P pixels, and (N, P) depths, in the frame's precision."""
    r, a, real = {name: records[name][:, None] for name in records.dtype.names}, attributes, records["z"].dtype.type
    dx, dy = (x - r["pixel_x"]) - r["offset_x"], (y - r["pixel_y"]) - r["offset_y"]
    u = (r["u_x"] * dx + r["u_y"] * dy) + r["u_1"]
    v = (r["v_x"] * dx + r["v_y"] * dy) + r["v_1"]
    slope = r["g_x"] * dx + r["g_y"] * dy
    den = slope + real(1) if projection == "perspective" else np.ones_like(slope)
    z = real(1) / den * r["z"] if projection == "perspective" else slope + r["z"]
    exists = (u * u + v * v <= den * den) & (den > 0)
    filter_x, filter_y = dx - a["prefilter_x"][:, None], dy - a["prefilter_y"][:, None]
    near = filter_x * filter_x + filter_y * filter_y <= settings.prefilter_radius**2 * 1.001
    filtered = near & ~exists & (settings.prefilter == "min")
    return exists | filtered, np.where(filtered, r["center_z"], z)


@in_ways(DISCS)
@pytest.mark.parametrize("precision", ["single", "double"])
@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
@pytest.mark.filterwarnings("ignore:.*encountered:RuntimeWarning")
def test_no_fragment_is_nearer_than_its_key_or_outside_its_quarters(device, no_front, projection, precision, ways):
    """Mutations: DEPTH_SLACK or DISTANCE_SLACK negative; `first` for `last` in key_of."""
    num_sure = num_fragments = 0
    for seed in range(60):
        rng = np.random.default_rng(seed)
        camera = any_camera(rng, projection)
        tile_size, footprint, prefilter, _ = ways[seed % len(ways)]
        settings = any_settings(rng, precision, footprint, prefilter)
        passes = DevicePasses(device, any_discs(rng, camera), camera, settings, tile_size)
        for left, top, records, attributes, keys in read_keys(passes, tile_size):
            y, x = (axis.ravel() for axis in np.mgrid[top : top + tile_size, left : left + tile_size])
            inside = (x < camera.width) & (y < camera.height)
            x, y = x[inside], y[inside]
            drawn = (x >= records["x_min"][:, None]) & (x <= records["x_max"][:, None])
            drawn &= (y >= records["y_min"][:, None]) & (y <= records["y_max"][:, None])
            real = records["z"].dtype.type
            exists, z = fragments_of(records, attributes, real(x), real(y), settings, projection)
            drawn &= exists & (z >= camera.near) & (z <= camera.far)
            first_x, last_x, first_y, last_y = (keys >> shift & 3 for shift in (0, 2, 4, 6))
            quarter_x, quarter_y = (x - left) // (tile_size // 4), (y - top) // (tile_size // 4)
            named = (quarter_x >= first_x[:, None]) & (quarter_x <= last_x[:, None])
            named &= (quarter_y >= first_y[:, None]) & (quarter_y <= last_y[:, None])
            assert not (drawn & ~named).any(), seed
            near_z = (keys & 0x7FFFFF00).view(np.float32)
            assert not (drawn & (z < near_z[:, None]))[near_z > 0].any(), seed  # 0: unknown depth
            num_sure += np.count_nonzero(near_z[drawn.any(axis=1)] > 0)
            num_fragments += np.count_nonzero(drawn)
    assert num_sure > 1000 and num_fragments > 20000


def test_a_depth_is_known_of_most_splats(device, no_front):
    """Keys of a sphere's splats have a depth, to a hundredth of the center's z, except near edge-on."""
    splats, camera = scene("sphere"), CAMERAS["outside"]
    passes = DevicePasses(device, splats, camera, RenderSettings(epsilon=0.0))
    for _, _, records, _, keys in read_keys(passes, 16):
        near_z = (keys & 0x7FFFFF00).view(np.float32)
        center_z = (splats.center @ camera.eye_from_world[2, :3] + camera.eye_from_world[2, 3])[records["id"]]
        known = near_z > 0
        reach = (np.abs(splats.tangent_u) + np.abs(splats.tangent_v)).sum(axis=1)[records["id"]]
        assert (near_z[known] > (center_z - reach - 0.01 * center_z)[known]).all()
        assert np.count_nonzero(~known) <= 0.3 * len(known) + 1
