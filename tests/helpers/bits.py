"""Compare frames bit by bit."""

from __future__ import annotations

import numpy as np

NONE = 0xFFFFFFFF


def arrays(frame):
    return dict(frame)


def assert_same_bits(a, b, where=np.s_[:]):
    """Assert that the AOVs of `a`, at `where`, equal those of `b`: names in order, types, shapes and bits."""
    assert list(a) == list(b)
    for name in a:
        one, other = a[name][where], b[name]
        assert (one.dtype, one.shape) == (other.dtype, other.shape), name
        assert one.tobytes() == other.tobytes(), f"{name}: {np.count_nonzero(one != other)} differ"
