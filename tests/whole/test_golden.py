"""The golden images (splatcl/evidence/golden/golden.json) have the same bits in every way of working.

.ci/runtimes checks them on five runtimes. Each docstring names a mutation that failed the test when put in by hand;
test_another_rounding_is_noticed puts in those of `ROUNDINGS`.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys

import numpy as np
import pytest
from helpers.paths import ROOT

from splatcl import Frame, Renderer
from splatcl.errors import DeviceError
from splatcl.evidence.golden import check as golden
from splatcl.opencl.device.devices import choose_device
from splatcl.opencl.device.program import Program
from splatcl.opencl.passes import bin as bin_pass
from splatcl.opencl.state import context

MANY = """
import os, sys
os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[: int(sys.argv[1])])
from splatcl import Renderer
from splatcl.evidence.golden import check as golden
from splatcl.evidence.golden.splats import random_discs
renderer, scene = Renderer(), golden.scenes()[0]
many = random_discs(8, 200_000, 1.25, 0.0625)
images = {str(golden.digest(renderer.render(many, scene.camera, scene.settings))) for _ in range(8)}
print(renderer._device.info.handle.max_compute_units, len(images), *golden.check(renderer), *images, sep="\\n")
"""

SUM = "h.u = (s->u_x * h.dx + s->u_y * h.dy) + s->u_1;"
QUEUED = "place[num] = i;\n    num += near_z[i] <= farthest;"
ROOT_TEXT = "#if ON_POCL && LANES == 8 && !DOUBLE && defined(__AVX__)"
ROUNDINGS = {  # code, and a replacement with another rounding or another order of two roundings
    "association": ("(a.x * b.x + a.y * b.y) + a.z * b.z", "a.x * b.x + (a.y * b.y + a.z * b.z)"),
    "order of sums": (
        QUEUED,
        "const int k = begin + end - 1 - i; " + QUEUED.replace("[i]", "[k]").replace("= i", "= k"),
    ),
    "fma": (SUM, "h.u = fma((reals)s->u_x, h.dx, (reals)(s->u_y * h.dy)) + s->u_1;"),
    "contraction": ("#pragma OPENCL FP_CONTRACT OFF", "#pragma OPENCL FP_CONTRACT ON"),
    "library exp": ("return exp_negative(r2 * falloff);", "return exp(r2 * falloff);"),
    "library pow": (
        "power(at_most(dot3(mirrored, s->to_eye), R(1.0)), ",
        "pow(clamp(dot3(mirrored, s->to_eye), R(0.0), R(1.0)), (reals)",
    ),
    "inverse square root": (
        ROOT_TEXT,
        f"#if LANES > 1\n#define square_root(x) ((x) * rsqrt(x))\n#elif {ROOT_TEXT[4:]}",
    ),
    "reciprocal": ("#define divide(a, b) ((a) / (b))", "#define divide(a, b) ((a) * ((real)1 / (b)))"),
}


def altered_kernels(monkeypatch, good, bad):
    """Build every later kernel with `bad` in place of `good`; return a list of whether each had `good`."""
    import pyopencl as cl

    real, found = cl.Program, []

    def program(context, source):
        found.append(good in source)
        return real(context, source.replace(good, bad))

    monkeypatch.setattr(cl, "Program", program)
    return found


FEW = ("ordinary", "near_plane", "edge_on", "sub_pixel", "sub_pixel_bounds", "layers_front", "along_ray", "lights")
"""Scenes that share programs: a tenth of the programs of all scenes."""
METHODS = ("zwicker04", "tiny_everything")
"""Scenes of two methods; the splats of the second have all extras."""


def check_few(renderer):
    return golden.check(renderer, FEW)


def check_few_and_methods(renderer):
    return golden.check(renderer, FEW + METHODS + ("tiny_double",) * renderer.supports_double)


def check_plain(renderer):
    """Check the scenes of [BHZK05]'s method, which compile a minute faster than all scenes."""
    return golden.check(renderer, [scene.name for scene in golden.scenes() if scene.plain])


SLOW = pytest.mark.slow
"""Mark of checks that compile for half a minute; .ci/runtimes runs most of them too, on every runtime."""
ALL = pytest.param(golden.check, marks=SLOW)
PLAIN = pytest.param(check_plain, marks=SLOW)


def ways(name, fast, *others):
    """Parametrize a way of working and its check: few scenes for `fast`, the plain scenes (slow) for every way."""
    slow = [pytest.param(way, check_plain, marks=SLOW) for way in (fast, *others)]
    return pytest.mark.parametrize((name, "check"), [(fast, check_few), *slow])


@pytest.fixture(scope="module")
def scenes():
    return {scene.name: scene for scene in golden.scenes()}


def test_every_scene_has_its_hashes(scenes):
    assert len(scenes) == len(golden.scenes())
    assert set(golden.stored()) == set(scenes)
    assert all(len(golden.stored()[name]) == 10 for name, scene in scenes.items() if scene.plain)
    assert "attribute.height" in golden.stored()["attributes"] and "albedo" not in golden.stored()["botsch04"]


def test_the_page_of_results_is_of_these_hashes():
    page = (ROOT / "docs" / "trust" / "reproducibility.md").read_text()
    for name, hashes in golden.stored().items():
        cells = re.search(rf"^\| {name} \|(.*)\|$", page, re.MULTILINE)
        assert cells and set(cells[1].split()) - {"|", "-"} == {golden.one_hash(hashes)[:8]}, name
    assert page.endswith(f"\n{len(golden.scenes())} scenes, 0 of them different.\n")


def test_the_page_of_results_counts_the_scenes_of_each_runtime():
    page = (ROOT / "docs" / "trust" / "reproducibility.md").read_text()
    header, *rows = re.findall(r"^\| (.*) \|$", page[page.index("\n| scene |") :], re.MULTILINE)
    scenes = [row.split(" | ") for row in rows[1:]]
    assert [name for name, *_ in scenes] == [scene.name for scene in golden.scenes()]
    for column, runtime in enumerate(header.split(" | ")[1:], 1):
        count = sum(row[column] != "-" for row in scenes)
        assert re.search(rf"^\| {runtime} \| .* \| \d+ \| {count} \|$", page, re.MULTILINE), runtime


def test_the_default_device(renderer):
    """Mutation: each of `ROUNDINGS`."""
    assert golden.check(renderer) == []


@ways("tile_size", 32, 8, 64)
def test_tile_sizes(tile_size, check):
    """Mutation: `least(REGION, 16) - 1` in place of `REGION - 1` in boxes_of."""
    assert check(Renderer(tile_size=tile_size)) == []


@pytest.mark.parametrize("every", [False, pytest.param(True, marks=SLOW)])
def test_tiles_and_lanes_of_every_method(scenes, every):
    """Mutation: `lane / 4 * REGION + lane % 4` in block_offsets, 4 in place of BLOCK_X."""
    names = [name for name, scene in scenes.items() if not scene.plain and scene.settings.precision == "single"]
    assert set(METHODS) < set(names)
    assert golden.check(Renderer(lanes=4, tile_size=32), names if every else METHODS) == []


@ways("lanes", 1, 4, 16)
def test_lanes(lanes, check):
    """Mutation: `row * 4 + column` in add_large_box, 4 in place of BLOCK_X."""
    if lanes == 16 and "PoCL 3.0" in choose_device().version:
        with pytest.raises(DeviceError, match="cannot compile 16-wide square roots"):
            Renderer(lanes=lanes)
    else:
        assert check(Renderer(lanes=lanes)) == []


@pytest.mark.parametrize(
    ("tile_size", "check"),
    [(16, check_few_and_methods), *(pytest.param(*way, marks=SLOW) for way in ((8, golden.check), (16, check_plain)))],
)
def test_a_work_item_per_pixel(tile_size, check):
    """Mutation: `part / (TILE / 2)` in place of `part / REGIONS_X` in region_of."""
    assert check(Renderer(mapping="pixel", tile_size=tile_size)) == []


@ways("group", 16, 1, 32)
def test_group_sizes_of_pixels(monkeypatch, group, check):
    """Mutation: region_of in visibility.cl takes `get_group_id(0) * get_local_size(0) / 64 * 64 + get_local_id(0)`."""
    monkeypatch.setattr(context, "PIXEL_GROUP", group)
    assert check(Renderer(mapping="pixel")) == []


@pytest.mark.parametrize("check", [check_few_and_methods, ALL])
def test_group_sizes_of_tiles_chunks_and_images(monkeypatch, check):
    """Mutation: region_of in visibility.cl takes `get_group_id(0)`."""

    def call(program, queue, name, size, group, *args):
        groups = tuple(next(n for n in (4, 3, 2, 1) if length % n == 0) for length in size)
        program.kernels[name](queue, size, groups, *args)

    monkeypatch.setattr(Program, "__call__", call)
    assert check(Renderer()) == []


@pytest.mark.parametrize(("least", "most"), [(16, 1000), (48, 3)])
def test_chunks_and_bands(monkeypatch, least, most):
    """Mutation: the loop of bin_scatter runs from `end - 1` down to `begin`."""
    bands = bin_pass.bands
    monkeypatch.setattr(bin_pass, "MIN_CHUNK", least)
    monkeypatch.setattr(bin_pass, "MAX_CHUNKS", most)
    monkeypatch.setattr(bin_pass, "bands", lambda totals, _: bands(totals, 100))
    assert golden.check(Renderer()) == []


@pytest.mark.parametrize("check", [check_few, PLAIN])
def test_quarters_of_tiles(monkeypatch, check):
    """Work-items take quarters of tiles where a few tiles hold most splats.

    Mutation: `part / REGIONS` in place of `part / REGIONS_X` in region_of.
    """
    monkeypatch.setattr(context, "FEW_TILES", 1000)
    monkeypatch.setattr(context, "MANY_ENTRIES", -1)
    assert check(Renderer()) == []


def test_threads():
    """Mutation: `atomic_inc(tile_offsets + tile)` in place of `offsets[tile]++` in bin_scatter."""
    if len(os.sched_getaffinity(0)) < 2:
        pytest.skip("one core")
    outputs = []
    for threads in "12":
        environment = {**os.environ, "POCL_MAX_PTHREAD_COUNT": threads}
        command = [sys.executable, "-c", MANY, threads]
        result = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=300, check=False)
        outputs.append(result.stdout.splitlines())
        assert outputs[-1][:2] == [threads, "1"], result.stderr
    assert len(outputs[0]) == 3 and outputs[0][2] == outputs[1][2]


@pytest.mark.parametrize("check", [check_few, PLAIN])
def test_our_own_division_and_square_root(monkeypatch, check):
    """divide.h replaces operations that a runtime does not round correctly. Mutation: NEWTON_STEPS two fewer."""
    renderer = Renderer()
    monkeypatch.setattr(renderer._device.strictness, "options", lambda _: {"EXACT_DIVIDE": 0, "EXACT_SQRT": 0})
    assert check(renderer) == []


@pytest.mark.usefixtures("renderer")  # it remembers the arithmetic of the unaltered kernels
@pytest.mark.parametrize("name", ROUNDINGS)
def test_another_rounding_is_noticed(monkeypatch, name):
    found = altered_kernels(monkeypatch, *ROUNDINGS[name])
    renderer = Renderer(allow_inexact=True)
    scene = "lights" if name in ("library pow", "order of sums") else "culled"  # which has few programs
    assert golden.check(renderer, [scene]) != []
    assert any(found)


def test_a_digest_tells_bits_types_and_shapes_apart(scenes):
    array = np.zeros((2, 3), np.float32)
    variants = [array, -array, array.astype(np.uint32), array.T, array + np.float32(1e-45)]
    digests = [golden.digest(Frame({"Z": v}, scenes["tiny"].camera, scenes["tiny"].settings))["Z"] for v in variants]
    assert len(set(digests)) == len(variants)
    assert golden.digest(Frame({"Z": array.astype(">f4")}, scenes["tiny"].camera, scenes["tiny"].settings)) == {
        "Z": digests[0]
    }


def test_a_mismatch_is_one_line_for_each_aov(renderer, monkeypatch):
    wrong = json.loads(json.dumps(golden.stored()))
    wrong["tiny"]["Z"] = "0" * 64
    del wrong["tiny"]["N"]
    monkeypatch.setattr(golden, "stored", lambda: wrong)
    lines = golden.check(renderer, ["tiny", "tiny_table"])
    assert [line.split(":")[0] for line in lines] == ["tiny N", "tiny Z"]
    assert lines[0].endswith(", not missing") and lines[1].endswith(", not 000000000000")
