"""The benchmark's limits: the work of each pass, and the least time that memory and arithmetic allow."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import splatcl
from splatcl.apps.bench import matrix, roofline
from splatcl.apps.bench.matrix import BASE, Row
from splatcl.apps.bench.measure import Drawn, Fragments, Result
from splatcl.apps.bench.passes import PASSES, Counts
from splatcl.apps.bench.roofline import Limits, Roofline
from splatcl.apps.bench.work import FLOPS, limits_of, work_of
from splatcl.apps.timing import Spread

SMALL = 1 << 20


def result_of(settings=BASE, **seconds):
    """Return a result with round numbers."""
    row = Row(1000, settings)
    counts = Counts(
        1000, 600, 900, 850, 800, 700, 400, 500, 50, 36, 16, 4 if settings.facing == "cull" else 8, 48, 64, 32, 4
    )
    drawn = Drawn(80, 40)
    times = {name: Spread((seconds.get(name, 1.0),)) for name in PASSES}
    return Result(row, settings.facing, counts, Fragments(drawn, drawn, drawn, 100), Spread((2.0,)), times)


def test_work_by_hand():
    settings = replace(BASE, lights=matrix.THREE_LIGHTS)
    work = work_of(result_of(settings))
    assert vars(work["bin"]) == {
        "read_bytes": 1000 * 36 + 600 * 16,
        "written_bytes": 600 * 16 + 900 * 4,
        "flops": 1000 * (FLOPS["splat"] + FLOPS["culled splat"]) + 600 * FLOPS["listed"],
    }
    assert vars(work["project"]) == {
        "read_bytes": 900 * 4 + 850 * 48,
        "written_bytes": 850 * (64 + 32 + 8) + 900 * 8,
        "flops": 850 * FLOPS["entry"],
    }
    assert vars(work["visibility"]) == {
        "read_bytes": 900 * 4 + 800 * (64 + 4),
        "written_bytes": 50 * 8,
        "flops": 800 * FLOPS["taken"] + 400 * FLOPS["tested lane"] + 100 * FLOPS["hit"],
    }
    taken, fragments = 700 * FLOPS["taken"], 80 * FLOPS["fragment"]
    assert vars(work["attributes"]) == {
        "read_bytes": 900 * 4 + 700 * (64 + 32 + 8) + 50 * 4,
        "written_bytes": 50 * 36,
        "flops": taken + 500 * FLOPS["prefiltered lane"] + fragments,
    }
    assert vars(work["shade"]) == {
        "read_bytes": 50 * 36,
        "written_bytes": 50 * 16,
        "flops": 40 * (FLOPS["pixel"] + FLOPS["ambient"] + 3 * FLOPS["light"]),
    }
    plain = work_of(result_of(replace(settings, shader="albedo", prefilter="none")))
    assert plain["shade"].flops == 40 * FLOPS["pixel"]
    assert plain["attributes"].flops == taken + 500 * FLOPS["filtered lane"] + fragments
    kept = work_of(result_of(replace(settings, facing="keep")))
    assert kept["bin"].flops == 1000 * FLOPS["splat"] + 600 * (FLOPS["listed"] + FLOPS["layered"])
    assert kept["bin"].written_bytes == 600 * 16 + 900 * 8 and kept["project"].read_bytes == 900 * 8 + 850 * 48


def test_a_pass_is_held_against_the_slower_of_memory_and_arithmetic():
    result = result_of(project=10.0)
    slow_memory = Limits(read=100.0, write=1000.0, copy=1.0, flops={"single": 1e9})
    limit = limits_of(result, slow_memory)["project"]
    assert limit.bound == "memory"
    assert limit.limit_seconds == pytest.approx(44400 / 100 + 95600 / 1000)
    assert limit.share_of_limit == pytest.approx(limit.limit_seconds / 10)
    slow_arithmetic = Limits(read=1e9, write=1e9, copy=1.0, flops={"single": 1e3})
    limits = limits_of(result, slow_arithmetic)
    assert limits["project"].bound == "arithmetic"
    assert limits["visibility"].lanes_used == pytest.approx(100 / 400)
    assert limits["attributes"].lanes_used == pytest.approx(80 / 500)
    assert limits["bin"].lanes_used is None


@pytest.mark.parametrize("mapping", ["tile", "pixel"])
@pytest.mark.parametrize("precision", ["single", "double"])
def test_roofline_kernels_touch_every_number(mapping, precision):
    device = splatcl.Renderer(mapping=mapping).device
    if precision == "double" and device.info.supports["double"] != "yes":
        pytest.skip("no double precision")
    one = Roofline(device, SMALL, precision)
    real = np.dtype("f4" if precision == "single" else "f8")
    count = one.num_bytes // real.itemsize
    written = device.read(one._numbers, (count,), real)
    items, each = np.unique(written, return_counts=True)
    assert len(items) == one._num_items and (each == count // len(items)).all()
    np.testing.assert_array_equal(device.read(one._copy, (count,), real), written)
    numbers = (np.arange(count) % 1021).astype(real)
    device.write(one._numbers, numbers)
    one.read()
    sums = device.read(one._sums, (one._num_items, one._lanes), real)
    assert sums.sum(dtype=np.float64) == numbers.sum(dtype=np.float64)
    if mapping == "pixel":
        return  # arithmetic sized for a GPU takes a CPU seconds
    assert one.arithmetic() > 0
    sums = device.read(one._sums, (one._num_items, one._lanes), real)
    np.testing.assert_allclose(sums, roofline.CHAINS, rtol=1e-3)  # a = 0.999 a + 0.001 tends to 1
