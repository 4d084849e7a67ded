"""Operands that expose incorrect rounding: special values, near ties of the rounding, and pseudo-random numbers."""

from __future__ import annotations

import itertools
import random
from collections.abc import Iterator
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splatcl.scene.settings import Precision

REALS: dict[Precision, type[np.floating[Any]]] = {"single": np.float32, "double": np.float64}
"""NumPy type of each precision's real."""
MODERATE = 2.0**40
"""Largest moderate size, 1 / MODERATE the least: sums, products and rounding errors of a few are not subnormal."""


@cache
def operands(precision: Precision, count: int) -> NDArray[Any]:
    """Return (4, count) operands a, b, c, d, the same in every run; `count` is at least 4096.

    They include all pairs of special values, and quotients a / b and roots of a close to a tie. Sums a + b and a c + b
    cancel in some. The others are numbers of moderate size and arbitrary bit patterns.
    """
    rng, dtype = np.random.default_rng(2005), REALS[precision]
    special = np.array(list(itertools.product(_special(dtype), repeat=2)), dtype).T
    quotients = np.array(list(itertools.islice(hard_quotients(dtype), 256)), dtype).T
    roots = np.array(list(itertools.islice(hard_roots(dtype), 256)), dtype)
    rest = count - special.shape[1] - 2 * 256
    moderate = _moderate(rng, dtype, rest // 2)
    bits = np.dtype(f"u{np.dtype(dtype).itemsize}")
    patterns = rng.integers(0, np.iinfo(bits).max, (4, rest - rest // 2), bits, endpoint=True).view(dtype)
    canceling = moderate[:, ::2]
    canceling[1] = -(canceling[0] * canceling[2])
    canceling[3] = np.nextafter(canceling[2], dtype(0))
    a_b = np.concatenate([special, quotients, np.stack([roots, -roots])], axis=1)
    blocks = [np.concatenate([a_b, a_b[::-1]]), moderate, patterns]
    return np.concatenate(blocks, axis=1)


def _special(dtype: type[np.floating[Any]]) -> list[Any]:
    info = np.finfo(dtype)
    one = dtype(1)
    positive = [
        *(0, 0.5, 1, 2, 3, 10, 1 / 3, 1e-30, 2.0 ** (info.nmant - 1) + 0.5, 2.0**info.nmant + 1, 2.0**31, np.inf),
        *(one + info.eps, one - info.epsneg, info.max, info.tiny, info.smallest_subnormal),
        np.nextafter(info.tiny, dtype(0)),
    ]
    return [*positive, *(-number for number in map(dtype, positive)), np.nan]


def _moderate(rng: np.random.Generator, dtype: type[np.floating[Any]], count: int) -> NDArray[Any]:
    """Return (4, count) numbers of either sign and of sizes from 2^-20 to 2^20."""
    sign = rng.choice([-1.0, 1.0], (4, count))
    return (sign * (1 + rng.random((4, count))) * 2.0 ** rng.integers(-20, 20, (4, count))).astype(dtype)


def hard_quotients(dtype: type[np.floating[Any]]) -> Iterator[tuple[float, float]]:
    """Yield a, b whose quotient is as close as possible to a tie: the middle q between two neighboring numbers.

    Let the precision be p bits, and b and q whole numbers of p and p + 1 bits. Then a = (q b + r) / 2^p with r = 1 or
    -1 is whole if q = -r / b (mod 2^p).
    """
    p = np.finfo(dtype).nmant + 1
    choose = random.Random(p)
    while True:
        b, r = choose.randrange(1 << (p - 1), 1 << p) | 1, choose.choice((-1, 1))
        q = (1 << p) + (-r * pow(b, -1, 1 << p)) % (1 << p)
        a = (q * b + r) >> p
        if a < 1 << p:
            yield float(a), float(b)


def hard_roots(dtype: type[np.floating[Any]]) -> Iterator[float]:
    """Yield x whose root is as close as possible to a tie: the middle s between two neighboring numbers.

    Let the precision be p bits, and s and m whole numbers of p + 1 and p bits. Then x = m 2^k = s^2 - r for small
    r = 1 (mod 8); for such r, s^2 = r (mod 2^k) has four solutions.
    """
    p = np.finfo(dtype).nmant + 1
    for i in itertools.count():
        for r, k in itertools.product((8 * i + 1, -8 * i - 7), (p + 1, p + 2)):
            for s in _roots_of(r, k):
                m = (s * s - r) >> k
                if 1 << p <= s < 2 << p and m < 1 << p:
                    yield float(m) * 2.0 ** (k - 2 * p)


def _roots_of(r: int, k: int) -> Iterator[int]:
    """Yield the four whole numbers whose square is `r` (mod 2^k), for r = 1 (mod 8)."""
    root = 1
    for bit in range(3, k):  # the last `bit` bits of the root are right; correct one more
        if (root * root - r) >> bit & 1:
            root += 1 << (bit - 1)
    for sign, half in itertools.product((1, -1), (0, 1 << (k - 1))):
        yield (sign * root + half) % (1 << k)
