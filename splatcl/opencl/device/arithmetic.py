"""Compare a device's arithmetic with NumPy's, operation by operation (kernels/evidence/doctor.cl).

Every operation of the kernels must give the correctly rounded result, so NumPy's bits. Division and square root may
instead be splatcl's own (kernels/arithmetic/divide.h). Cases with subnormal numbers count separately
(`Arithmetic.subnormals`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splatcl.opencl.device.hard_cases import MODERATE, operands
from splatcl.opencl.device.queue import DeviceQueue
from splatcl.scene.settings import Precision

LANES: dict[Precision, tuple[int, ...]] = {"single": (1, 4, 8), "double": (1, 4)}
"""Vector widths that kernels may use: at most 32 bytes."""
QUICK, THOROUGH = 4096, 65536
"""Numbers of the test before rendering, and of the doctor's."""
NUMBERS_PER_ITEM = 512
"""Numbers that one work-item tests."""
REPLACEABLE = {"divide": "EXACT_DIVIDE", "reciprocal": "EXACT_DIVIDE", "square_root": "EXACT_SQRT"}
"""Operations that kernels/arithmetic/divide.h can replace; the build option is 1 if the device's own is exact."""
UNWRITTEN = 0x0DEAD0FF
"""Bits of the results before the kernel runs; it must overwrite all of them."""


@dataclass(frozen=True)
class Operation:
    """One row of kernels/evidence/doctor.cl.

    Parameters
    ----------
    formula : str
        The operation in words, over the operands a, b, c, d.
    expected : callable
        Returns NumPy's result from a, b, c, d and the lanes: reals, or signed integers of the same width.
    applies : callable, optional
        Returns from a, b, c, d where the result is defined; everywhere by default.
    """

    formula: str
    expected: Callable[..., Any]
    applies: Callable[..., Any] | None = None


def _moderate(*numbers: Any) -> Any:
    sizes = [np.abs(x) for x in numbers]
    return np.all([(x == 0) | ((x >= 1 / MODERATE) & (x <= MODERATE)) for x in sizes], axis=0)


def _bits(x: Any) -> Any:
    return x.view(f"i{x.itemsize}")


def _truth(mask: Any, like: Any) -> Any:
    return -mask.astype(f"i{like.itemsize}")


def _rounding_of_sum(a: Any, b: Any, *_: Any) -> Any:
    total = a + b
    t = total - a
    return (a - (total - t)) + (b - t)


def _rounding_of_product(a: Any, b: Any, *_: Any) -> Any:
    """Return a b - round(a b) (Dekker 1971); Veltkamp's rule splits each factor in two."""
    factor = a.dtype.type(2.0 ** ((np.finfo(a.dtype).nmant + 2) // 2) + 1)
    a1, b1 = (factor * x - (factor * x - x) for x in (a, b))
    a2, b2 = a - a1, b - b1
    return ((a1 * b1 - a * b) + a1 * b2 + a2 * b1) + a2 * b2


def _round_even(a: Any, *_: Any) -> Any:
    magic = a.dtype.type(1.5 * 2.0 ** np.finfo(a.dtype).nmant)
    return np.where(np.abs(a) < magic / 3, (a + magic) - magic, a)


def _any(a: Any, b: Any, c: Any, d: Any, lanes: int) -> Any:
    return _truth(((a < b) & (c < d)).reshape(-1, lanes).any(axis=1).repeat(lanes), a)


OPERATIONS = {
    "add": Operation("a + b", lambda a, b, *_: a + b),
    "subtract": Operation("a - b", lambda a, b, *_: a - b),
    "negate": Operation("-a", lambda a, *_: -a),
    "multiply": Operation("a * b", lambda a, b, *_: a * b),
    "divide": Operation("a / b", lambda a, b, *_: a / b),
    "reciprocal": Operation("1 / a", lambda a, *_: 1 / a),
    "square_root": Operation("sqrt(a)", lambda a, *_: np.sqrt(a)),
    "multiply_add": Operation("a * c + b", lambda a, b, c, *_: a * c + b, _moderate),
    "multiply_subtract": Operation("b * c - a", lambda a, b, c, *_: b * c - a, _moderate),
    "subtract_product": Operation("c - a * d", lambda a, b, c, d, *_: c - a * d, _moderate),
    "sum": Operation("(b + c) + d", lambda a, b, c, d, *_: (b + c) + d, _moderate),
    "dot": Operation("(b * d + c * d) + d * d", lambda a, b, c, d, *_: (b * d + c * d) + d * d, _moderate),
    "rounding_of_sum": Operation("(a + b) - round(a + b)", _rounding_of_sum, _moderate),
    "rounding_of_product": Operation("a * b - round(a * b)", _rounding_of_product, _moderate),
    "round_even": Operation("round_even(a)", _round_even),
    "less": Operation("a < b", lambda a, b, *_: _truth(a < b, a)),
    "less_equal": Operation("a <= b", lambda a, b, *_: _truth(a <= b, a)),
    "greater": Operation("a > b", lambda a, b, *_: _truth(a > b, a)),
    "greater_equal": Operation("a >= b", lambda a, b, *_: _truth(a >= b, a)),
    "any": Operation("any(a < b & c < d)", _any),
    "select": Operation("c < d ? b : a", lambda a, b, c, d, *_: np.where(c < d, b, a)),
    "at_least": Operation("a > b ? a : b", lambda a, b, *_: np.where(a > b, a, b)),
    "at_most": Operation("a < b ? a : b", lambda a, b, *_: np.where(a < b, a, b)),
    "magnitude": Operation("|a|", lambda a, *_: np.abs(a)),
    "to_int": Operation("(int)a", lambda a, *_: a.astype("i4"), lambda a, *_: np.abs(a) < 2.0**31),
    "from_bits": Operation("(real)as_int(b)", lambda a, b, *_: _bits(b).astype(b.dtype)),
    "shift_right": Operation("as_int(a) >> mantissa", lambda a, *_: _bits(a) >> np.finfo(a.dtype).nmant),
    "shift_left": Operation("as_int(a) << 8", lambda a, *_: _bits(a) << 8),
    "bit_difference": Operation("as_int(a) - as_int(b)", lambda a, b, *_: _bits(a) - _bits(b)),
    "bit_and": Operation("as_int(a) & ~as_int(b)", lambda a, b, *_: _bits(a) & ~_bits(b)),
}
FMA = Operation("fma(a, b, -(a * b))", _rounding_of_product, lambda a, b, *_: _moderate(a, b) & (a * b != 0))
SUBNORMAL_TESTS = ("add", "subtract", "multiply", "less", "select")


@dataclass(frozen=True)
class Finding:
    """An operation whose results differ from NumPy's: how many cases, and the first one in words."""

    operation: str
    precision: Precision
    lanes: int
    num_tested: int
    num_wrong: int
    example: str

    def __str__(self) -> str:
        where = f"{self.operation} ({self.precision}, lanes {self.lanes})"
        return f"{where}: {self.num_wrong} of {self.num_tested} wrong; {self.example}"


@dataclass(frozen=True)
class Arithmetic:
    """Result of the test of one device in one precision.

    Parameters
    ----------
    precision : {"single", "double"}
    lanes : tuple of int
        Vector widths tested.
    num_tested : int
        Cases per operation and vector width.
    wrong : tuple of Finding
        Operations that differ from NumPy's; any of them can change an image.
    replaced : tuple of Finding
        Inexact division or square root of the device, which kernels/arithmetic/divide.h replaces.
    subnormals : tuple of Finding
        Operations that lose subnormal operands or results (below 1.2e-38 in single precision, 2.2e-308 in double).
    """

    precision: Precision
    lanes: tuple[int, ...]
    num_tested: int
    wrong: tuple[Finding, ...] = ()
    replaced: tuple[Finding, ...] = ()
    subnormals: tuple[Finding, ...] = ()

    @property
    def options(self) -> dict[str, int]:
        """Build options of every kernel; 1 if the device's own operation is correctly rounded."""
        replaced = {REPLACEABLE[finding.operation] for finding in self.replaced}
        return {option: int(option not in replaced) for option in REPLACEABLE.values()}


def examine(device: DeviceQueue, precision: Precision, lanes: tuple[int, ...], num_tested: int = QUICK) -> Arithmetic:
    """Test a device's arithmetic; if its division or square root is wrong, test splatcl's own instead.

    Parameters
    ----------
    device : DeviceQueue
    precision : {"single", "double"}
    lanes : tuple of int
        Vector widths to test.
    num_tested : int
        Cases per operation and vector width: a multiple of NUMBERS_PER_ITEM, at least 4096.
    """
    found = Arithmetic(precision, lanes, num_tested)
    wrong, subnormals = _compare(device, found, OPERATIONS)
    found = replace(found, replaced=tuple(finding for finding in wrong if finding.operation in REPLACEABLE))
    if found.replaced:
        wrong, subnormals = _compare(device, found, OPERATIONS)
    return replace(found, wrong=tuple(wrong), subnormals=tuple(subnormals))


def unfused(device: DeviceQueue, precision: Precision, lanes: tuple[int, ...], num_tested: int) -> list[Finding]:
    """Return the vector widths in which fma is not fused; no kernel uses fma.

    Raises
    ------
    DeviceError
        The runtime does not build it.
    """
    return _compare(device, Arithmetic(precision, lanes, num_tested), {"fma": FMA})[0]


def _compare(
    device: DeviceQueue, tested: Arithmetic, operations: Mapping[str, Operation]
) -> tuple[list[Finding], list[Finding]]:
    """Return the operations that are wrong for ordinary numbers, and those that are wrong for subnormal ones."""
    abcd = operands(tested.precision, tested.num_tested)
    ordinary = ~np.any(_subnormal(abcd), axis=0)
    wrong: list[Finding] = []
    subnormals: list[Finding] = []
    for lanes in tested.lanes:
        results = _run(device, abcd, lanes, list(operations), tested.options)
        for (name, operation), got in zip(operations.items(), results, strict=True):
            with np.errstate(all="ignore"):
                expected = operation.expected(*abcd, lanes)
                applies = np.full(got.shape, True) if operation.applies is None else operation.applies(*abcd)
            normal = ordinary
            if expected.dtype.kind == "f":
                got = got.view(expected.dtype)
                normal = ordinary & ~_subnormal(expected)
            differs = applies & _differs(got, expected)
            for cases, found in ((applies & normal, wrong), (applies & ~normal, subnormals)):
                if (differs & cases).any() and (found is wrong or name in SUBNORMAL_TESTS):
                    first = int(np.argmax(differs & cases))
                    example = _example(operation.formula, abcd[:, first], got[first], expected[first])
                    counts = int(cases.sum()), int((differs & cases).sum())
                    found.append(Finding(name, tested.precision, lanes, *counts, example))
    return wrong, subnormals


def _subnormal(x: Any) -> Any:
    """Return a mask of the subnormal numbers, and of the least normal ones, since rounding can make them."""
    return (x != 0) & (np.abs(x) <= np.finfo(x.dtype).tiny)


def _differs(got: Any, expected: Any) -> Any:
    """Return a mask of the results whose bits differ; any NaN equals any other."""
    if expected.dtype.kind != "f":
        return got != expected.astype(got.dtype)
    return (_bits(got) != _bits(expected)) & ~(np.isnan(got) & np.isnan(expected))


def _run(
    device: DeviceQueue, abcd: NDArray[Any], lanes: int, names: list[str], options: dict[str, int]
) -> NDArray[Any]:
    """Return the results of kernels/evidence/doctor.cl as integers, (len(names), count)."""
    count, size = abcd.shape[1], abcd.itemsize
    defines = {f"ROW_{name}": row for row, name in enumerate(names)} | {"FMA": int("fma" in names)}
    program = device.program("evidence/doctor.cl", "", LANES=lanes, DOUBLE=int(size == 8), **defines, **options)
    with device.lock:
        given, results = device.buffer(abcd.nbytes), device.buffer(len(names) * count * size)
        device.write(given, abcd)
        device.write(results, np.full((len(names), count), UNWRITTEN, f"i{size}"))
        program.kernels["doctor"](device.queue, (count // NUMBERS_PER_ITEM,), None, given, results, np.int32(count))
        return device.read(results, (len(names), count), f"i{size}")


def _example(formula: str, abcd: Any, got: Any, expected: Any) -> str:
    """Return one wrong case in words, with the reals in hexadecimal."""
    values = ", ".join(f"{name}={_text(x)}" for name, x in zip("abcd", abcd, strict=True) if name in formula)
    return f"{formula} with {values} gave {_text(got)}, not {_text(expected)}"


def _text(x: Any) -> str:
    return float(x).hex() if isinstance(x, np.floating) else str(int(x))
