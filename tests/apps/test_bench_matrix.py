"""The benchmark's rows, and the order and the number of its measurements."""

from __future__ import annotations

import math
from typing import get_args

import pytest

from splatcl.apps.bench import matrix
from splatcl.apps.bench.matrix import BASE, base_of, only, parse_sizes, rows, size_name
from splatcl.apps.timing import MIN_FRAMES, Spread, turn_by_turn
from splatcl.errors import SettingsError
from splatcl.scene.settings import METHODS, RenderSettings, Shader


def test_matrix_varies_one_factor_at_a_time():
    table = rows(matrix.SIZES)
    assert len({row.name for row in table}) == len(table)
    base = [row for row in table if not row.factor]
    assert [row.num_splats for row in base[::3]] == list(matrix.SIZES)
    assert {row.settings.facing for row in base} == {"keep", "flip", "cull"}
    factors = [row for row in table if row.factor]
    assert {row.num_splats for row in factors} == {1_100_000, 4_000_000}
    assert {row.settings.shader for row in table} == set(get_args(Shader))
    assert {row.settings.method for row in table} == set(METHODS)
    for row in factors:
        differing = [f for f in ("model", "order") if getattr(row, f) != getattr(base_of(row), f)]
        differing += ["size"] if row.width != 512 else []
        method = RenderSettings(method=row.settings.method, facing="cull")
        differing += ["method"] if method != BASE else []
        changed = [f for f, value in vars(row.settings).items() if value != getattr(method, f)]
        differing += [f for f in changed if f != "user_shader"]  # the shader's row sets user_shader too
        assert len(differing) == 1, row.name
        assert base_of(row) in table


def test_factors_are_varied_at_the_largest_of_other_sizes():
    table = rows((300, 500))
    assert {row.num_splats for row in table if row.factor} == {500}


def test_only_keeps_what_a_row_is_compared_with():
    table = rows((300, 500))
    chosen = only(table, "Shuffled")
    assert [row.label for row in chosen] == ["cull", "shuffled"]
    assert [row.label for row in only(table, "keep")] == ["keep", "keep"]
    assert {row.label for row in only(table, "keep, shuffled")} == {"keep", "cull", "shuffled"}
    with pytest.raises(SettingsError, match=r"nothing.*shuffled"):
        only(table, "nothing")


@pytest.mark.parametrize(
    ("text", "sizes"), [("137k", (137_000,)), ("1.1M,300", (300, 1_100_000)), (" 4M , 4M", (4_000_000,))]
)
def test_sizes(text, sizes):
    assert parse_sizes(text) == sizes


def test_size_names():
    assert [size_name(n) for n in (*matrix.SIZES, 300)] == ["137k", "655k", "1.1M", "4M", "8.3M", "14M", "300"]


def test_spread():
    spread = Spread((4.0, 1.0, 2.0, 3.0, 5.0))
    assert (spread.median, spread.quartiles, spread.minimum) == (3.0, (2.0, 4.0), 1.0)
    assert spread.as_json() == {"median": 3, "q1": 2, "q3": 4, "min": 1, "samples": [4, 1, 2, 3, 5]}


def test_jobs_take_turns():
    order, steps = [], []
    jobs = [lambda name=name: (order.append(name), {name: len(order)})[1] for name in "ab"]
    spreads = turn_by_turn(jobs, 3, math.inf, steps.append)
    assert "".join(order) == "ababab" and sum(steps) == 6
    assert [one[name].samples for one, name in zip(spreads, "ab", strict=True)] == [(1, 3, 5), (2, 4, 6)]


def test_slow_jobs_get_fewer_rounds():
    (spreads,) = turn_by_turn([lambda: {"a": 1.0}], 100, -1.0, lambda steps: None)
    assert len(spreads["a"].samples) == MIN_FRAMES
