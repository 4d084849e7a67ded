"""Examine a device: its arithmetic, the environment's compiler flags, and the golden images."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

from splatcl.errors import DeviceError
from splatcl.evidence.golden import check as golden
from splatcl.opencl.device import arithmetic
from splatcl.opencl.device.arithmetic import Arithmetic, Finding
from splatcl.opencl.device.devices import DeviceInfo
from splatcl.opencl.device.queue import DeviceQueue
from splatcl.opencl.device.strictness import injected_flags
from splatcl.opencl.session import Session
from splatcl.scene.settings import Precision

LABEL_WIDTH = 12
MAX_MISMATCHES = 8
"""Most differing AOVs of golden images in the readable report; it counts the rest."""


@dataclass(frozen=True)
class Report:
    """Result of one device's examination; `as_json` has all of it, `lines` a readable summary.

    Parameters
    ----------
    device : DeviceInfo
    problem : str
        Why the device cannot be examined; the other results are then empty.
    profiles : tuple of Arithmetic
        One per precision; no "double" if the device lacks it.
    fma : str
        "fused" if fma is fused in every vector width; no kernel uses it.
    flags : dict
        Environment variables that inject compiler flags, and the flags.
    num_golden : int
        Number of golden images rendered.
    golden : tuple of str
        AOVs of golden images whose hash differs.
    """

    device: DeviceInfo
    problem: str = ""
    profiles: tuple[Arithmetic, ...] = ()
    fma: str = ""
    flags: dict[str, str] | None = None
    num_golden: int = 0
    golden: tuple[str, ...] = ()

    @property
    def reasons(self) -> list[str]:
        """Reasons why the device is unfit for reference renders; empty if it is fit."""
        reasons = [self.problem] if self.problem else []
        reasons += [f"{variable} injects compiler flags" for variable in self.flags or ()]
        for profile in self.profiles:
            names = sorted({finding.operation for finding in profile.wrong})
            reasons += [f"{profile.precision} precision: {', '.join(names)} wrong"] if names else []
        if self.golden:
            reasons.append(f"{len(self.golden)} AOVs of the golden images differ")
        return reasons

    def as_json(self) -> dict[str, Any]:
        """Return the report in JSON's types."""
        device = {key: getattr(self.device, key) for key in ("index", "platform", "name", "version", "is_default")}
        return {
            "device": device | {"supports": dict(self.device.supports)},
            "fit": not self.reasons,
            "reasons": self.reasons,
            "profiles": [asdict(p) | {"strict": not p.wrong, "options": p.options} for p in self.profiles],
            "fma": self.fma,
            "flags": self.flags or {},
            "golden": {"num_scenes": self.num_golden, "mismatches": list(self.golden)},
        }

    def lines(self) -> Iterator[str]:
        """Yield the lines of the readable report."""
        device = self.device
        yield f"{device.index}  {device.name}"
        yield f"   {device.platform}, {device.version}"
        for label, text in self._facts():
            yield f"   {label:<{LABEL_WIDTH}} {text}"

    def _facts(self) -> Iterator[tuple[str, str]]:
        for profile in self.profiles:
            yield profile.precision, _verdict(profile)
            yield from (("", str(finding)) for finding in profile.wrong)
        if self.profiles:
            if len(self.profiles) == 1:
                yield "double", "not supported"
            yield "division", _source(self.profiles, "EXACT_DIVIDE")
            yield "square root", _source(self.profiles, "EXACT_SQRT")
            yield "subnormals", _subnormals(self.profiles)
            yield "fma", f"{self.fma} (no kernel uses it)"
        yield "flags", ", ".join(f"{name}={value}" for name, value in (self.flags or {}).items()) or "none injected"
        if self.num_golden:
            yield "golden", f"{len(self.golden)} AOVs differ" if self.golden else f"all {self.num_golden} images match"
            yield from (("", mismatch) for mismatch in self.golden[:MAX_MISMATCHES])
            if len(self.golden) > MAX_MISMATCHES:
                yield "", f"... and {len(self.golden) - MAX_MISMATCHES} more"
        yield "verdict", f"unfit: {'; '.join(self.reasons)}" if self.reasons else "fit for reference renders"


def examine(device: DeviceInfo) -> Report:
    """Test a device's arithmetic in every precision and vector width, and render the golden images on it."""
    flags = injected_flags()
    try:
        queue = DeviceQueue(device.index)
        precisions: list[Precision] = ["single", "double"] if device.supports["double"] == "yes" else ["single"]
        profiles = tuple(
            arithmetic.examine(queue, precision, arithmetic.LANES[precision], arithmetic.THOROUGH)
            for precision in precisions
        )
        fma = _fma(queue, precisions)
        session = Session(device.index, allow_inexact=True)
        mismatches = tuple(golden.check(session))
        return Report(device, "", profiles, fma, flags, len(golden.renderable(session)), mismatches)
    except DeviceError as error:
        return Report(device, str(error), flags=flags)


def _fma(queue: DeviceQueue, precisions: list[Precision]) -> str:
    try:
        found: list[Finding] = []
        for precision in precisions:
            found += arithmetic.unfused(queue, precision, arithmetic.LANES[precision], arithmetic.QUICK)
    except DeviceError:
        return "does not build"
    return f"wrong: {found[0]}" if found else "fused"


def _verdict(profile: Arithmetic) -> str:
    num, lanes = len(arithmetic.OPERATIONS), ", ".join(map(str, profile.lanes))
    if profile.wrong:
        wrong = {finding.operation for finding in profile.wrong}
        return f"NOT strict: {len(wrong)} of {num} operations differ from NumPy's (lanes {lanes})"
    return f"strict: {num} operations give NumPy's bits on {profile.num_tested} numbers (lanes {lanes})"


def _source(profiles: tuple[Arithmetic, ...], option: str) -> str:
    replaced = [f for p in profiles for f in p.replaced if arithmetic.REPLACEABLE[f.operation] == option]
    return f"splatcl's, the device's is wrong: {replaced[0]}" if replaced else "the device's own, correctly rounded"


def _subnormals(profiles: tuple[Arithmetic, ...]) -> str:
    lost = [finding for profile in profiles for finding in profile.subnormals]
    return f"flushed to zero, which affects only numbers below 1e-30: {lost[0]}" if lost else "kept"
