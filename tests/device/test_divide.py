"""kernels/arithmetic/divide.h against NumPy's division and square root, which are the processor's, bit for bit."""

from __future__ import annotations

import itertools
from decimal import Decimal
from fractions import Fraction

import numpy as np
import pytest

from splatcl.opencl.device import arithmetic
from splatcl.opencl.device.arithmetic import OPERATIONS
from splatcl.opencl.device.hard_cases import REALS, hard_quotients, hard_roots

OURS = {"EXACT_DIVIDE": 0, "EXACT_SQRT": 0}
BATCH = 1 << 18
CASES = [("single", 1), ("single", 8), ("double", 4)]


def wrong_cases(device, precision, lanes, a, b):
    """Return the pairs whose quotient, or root of `a`, is not NumPy's; skip any subnormal result or operand."""
    if precision == "double" and device.info.supports["double"] == "no":
        pytest.skip("the device has no double precision")
    abcd = np.stack([a, b, a, b]).astype(REALS[precision])
    rows = arithmetic._run(device, abcd, lanes, list(OPERATIONS), OURS)
    rows = dict(zip(OPERATIONS, rows, strict=True))
    wrong = []
    for name in ("divide", "square_root"):
        with np.errstate(all="ignore"):
            expected = OPERATIONS[name].expected(*abcd)
        normal = ~np.any([arithmetic._subnormal(x) for x in (abcd[0], abcd[1], expected)], axis=0)
        got = rows[name].view(expected.dtype)
        at = np.flatnonzero(normal & arithmetic._differs(got, expected))
        wrong += [(name, float(abcd[0, i]).hex(), float(abcd[1, i]).hex(), got[i], expected[i]) for i in at[:3]]
    return wrong


def in_batches(values):
    """Yield the values BATCH at a time; the last value fills the last batch."""
    for begin in range(0, len(values), BATCH):
        yield np.resize(values[begin : begin + BATCH], BATCH)


def random_bits(rng, precision, count):
    unsigned = np.dtype(f"u{np.dtype(REALS[precision]).itemsize}")
    return rng.integers(0, np.iinfo(unsigned).max, count, unsigned, endpoint=True).view(REALS[precision])


@pytest.mark.parametrize(("precision", "lanes"), CASES)
def test_random_bit_patterns(device, precision, lanes):
    """Two million pairs have any bits (infinities, zeros and NaN among them); as many lie between 1/2 and 2."""
    rng = np.random.default_rng(2)
    for _ in range(8):
        a, b = random_bits(rng, precision, BATCH), random_bits(rng, precision, BATCH)
        assert wrong_cases(device, precision, lanes, a, b) == []
        a, b = (rng.uniform(0.5, 2.0, BATCH).astype(REALS[precision]) for _ in "ab")
        assert wrong_cases(device, precision, lanes, a, b) == []


@pytest.mark.parametrize(("precision", "lanes"), CASES)
def test_the_hardest_quotients_and_roots(device, precision, lanes):
    """The exact results lie next to the middle between two numbers.

    Mutations: no correction of quotients; SPLIT_HALF 0.
    """
    dtype = REALS[precision]
    pairs = np.array(list(itertools.islice(hard_quotients(dtype), 50000)), dtype)
    signs = np.where(np.arange(BATCH) % 2, -1, 1)
    assert (
        wrong_cases(device, precision, lanes, np.resize(pairs[:, 0], BATCH), np.resize(pairs[:, 1], BATCH) * signs)
        == []
    )
    roots = np.array(list(itertools.islice(hard_roots(dtype), 50000)), dtype)
    assert wrong_cases(device, precision, lanes, np.resize(roots, BATCH), np.resize(roots[::-1], BATCH)) == []


def test_every_single_root(device):
    """The roots take all 2^24 significands with an even and an odd exponent; the quotients are reciprocals."""
    significands = np.arange(1 << 23, dtype=np.uint32)
    for exponent in (127, 128):
        for bits in in_batches(significands):
            a = (bits | np.uint32(exponent << 23)).view(np.float32)
            assert wrong_cases(device, "single", 8, a, a[::-1]) == []


@pytest.mark.parametrize("precision", ["single", "double"])
def test_the_hard_numbers_are_hard(precision):
    """Quotients and roots lie next to the middle between two numbers, never on it."""
    dtype = REALS[precision]
    p = np.finfo(dtype).nmant + 1
    for a, b in itertools.islice(hard_quotients(dtype), 100):
        assert float(dtype(a)) == a and float(dtype(b)) == b
        off = Fraction(a) / Fraction(b) * 2 ** (p - 1) % 1 - Fraction(1, 2)  # ulp
        assert 0 < abs(off) < Fraction(1, 2 ** (p - 1))
    for x in itertools.islice(hard_roots(dtype), 100):
        assert float(dtype(x)) == x
        square = int(Fraction(x) * 4**p)
        root = round(Decimal(square).sqrt())  # half ulp
        assert root % 2 and 0 < abs(square - root * root) < 2**10
