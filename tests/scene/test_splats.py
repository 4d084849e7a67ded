"""Splats: the invalid ones, and the reasons of their refusal."""

from __future__ import annotations

import numpy as np
import pytest

from splatcl import Splats
from splatcl.errors import InvalidSplatsError
from splatcl.scene.splats import BLOCK, REASONS

MISTAKES = {
    REASONS[1]: [("center", np.nan), ("color", np.inf), ("tangent_u", -np.inf)],
    REASONS[2]: [("center", 1e16), ("color", -1e16)],
    REASONS[3]: [("tangent_u", 0.0), ("tangent_v", 1e-16)],
    REASONS[4]: [(("tangent_u", "tangent_v"), ((5e9, 0, 0), (0, 5e9, 0)))],
}


def arrays(num, dtype=np.float64):
    rng = np.random.default_rng(5)
    return {name: rng.normal(size=(num, 3)).astype(dtype) for name in ("center", "tangent_u", "tangent_v", "color")}


@pytest.mark.parametrize("num", [0, 1, BLOCK, BLOCK + 1])
def test_good_splats_are_taken(num):
    splats = Splats(**arrays(num, np.float32))
    assert len(splats) == num and splats.num_dropped == 0


@pytest.mark.parametrize("place", [0, BLOCK - 1, BLOCK, 2 * BLOCK + 6])
@pytest.mark.parametrize("reason", MISTAKES)
def test_one_bad_splat_among_many_is_found(place, reason):
    for name, value in MISTAKES[reason]:
        given = arrays(2 * BLOCK + 7)
        for one, row in zip(name, value, strict=True) if isinstance(name, tuple) else [(name, value)]:
            given[one][place] = row
        with pytest.raises(InvalidSplatsError, match=rf"1 of {2 * BLOCK + 7} splats .1 with .*first is splat {place}"):
            Splats(**given)
        splats = Splats(**given, on_invalid="drop")
        assert reason in splats.notes[0] and splats.num_dropped == 1
        np.testing.assert_array_equal(splats.center, np.delete(given["center"], place, axis=0))


def test_strays_are_left_out_and_nothing_else():
    given = arrays(1000)
    given["center"][7] = 1e6
    assert len(Splats(**given).without_outliers()) == 999
    near = Splats(**given | {"center": given["center"] / np.linalg.norm(given["center"], axis=1, keepdims=True)})
    assert near.without_outliers() is near
