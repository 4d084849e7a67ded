"""The doctor: healthy devices pass, each broken operation is named, and a wrong device is refused for rendering.

The tests break devices on purpose: they edit the kernels' source on its way to the compiler, or set compiler flags.
"""

from __future__ import annotations

import json
import re
from dataclasses import replace
from importlib.resources import files

import numpy as np
import pytest
from helpers.paths import ROOT

import splatcl
from splatcl.cli import main
from splatcl.errors import DeviceError
from splatcl.evidence.doctor import Report, examine
from splatcl.evidence.golden import check as golden
from splatcl.io.exr import read_exr
from splatcl.opencl.device import arithmetic, devices, program
from splatcl.opencl.device import strictness as strict
from splatcl.opencl.device.strictness import Device

PAGE = (ROOT / "docs" / "trust" / "doctor.md").read_text()
SPLATS = splatcl.Splats(np.zeros((1, 3)), np.eye(3)[:1], np.eye(3)[1:2])
CAMERA = splatcl.Camera.look_at((0, 0, 3), (0, 0, 0), width=33, height=17)
DIVISION = ("#define divide(a, b) ((a) / (b))", "#define divide(a, b) ((a) * (R(1.0) / (b)))")
ROOT = (
    "#if ON_POCL && LANES == 8 && !DOUBLE && defined(__AVX__)",
    "#if 1\n#define square_root(x) ((x) * rsqrt(x))\n#elif 0",
)

MUTATIONS = {
    "multiply_add": ("RESULT(multiply_add, a * c + b)", "RESULT(multiply_add, fma(a, c, b))"),
    "multiply_subtract": ("b * c - a", "fma(b, c, -a)"),
    "subtract_product": ("c - a * d", "fma(-a, d, c)"),
    "dot": ("return (a.x * b.x + a.y * b.y) + a.z * b.z;", "return a.x * b.x + (a.y * b.y + a.z * b.z);"),
    "sum": ("(b + c) + d", "b + (c + d)"),
    "rounding_of_sum": ("(a - (s - t)) + (b - t)", "(reals)R(0.0)"),
    "rounding_of_product": ("+ a2 * b2}", "}"),
    "round_even": ("(x + ROUND_MAGIC) - ROUND_MAGIC", "x"),
    "add": ("RESULT(add, a + b)", "RESULT(add, SELECT(a + b, R(0.0), MASK(a == -b)))"),  # loses inf - inf
    "negate": ("RESULT(negate, -a)", "RESULT(negate, R(0.0) - a)"),  # loses -0
    "less": ("RESULT_BITS(less, MASK(a < b))", "RESULT_BITS(less, ~MASK(a >= b))"),  # NaN
    "any": ("MASK(a < b) & MASK(c < d)) ?", "MASK(a < b)) ?"),
    "at_least": ("RESULT(at_least, at_least(a, b))", "RESULT(at_least, fmax(a, b))"),  # NaN
    "magnitude": ("RESULT(magnitude, magnitude(a))", "RESULT(magnitude, SELECT(a, -a, MASK(a < R(0.0))))"),  # -0
    "to_int": ("= (int)((const real *)&a)[lane]", "= convert_int_rte(((const real *)&a)[lane])"),
    "from_bits": ("(real)((const bits *)&b)[lane]", "convert_float_rtz(((const bits *)&b)[lane])"),
    "shift_right": ("AS_BITS(a) >> (bits)MANTISSA", "(AS_BITS(a) >> (bits)MANTISSA) & (bits)511"),
}

CULL = splatcl.RenderSettings(facing="cull")  # one layer alone halves the programs to build
GOLDEN = ("ordinary", "near_plane", "along_ray", "lights")
MORE_GOLDEN = ("orthographic", "table_linear")
"""Golden scenes that compile further programs."""


@pytest.fixture
def tiny_golden(monkeypatch):
    """Reduce the golden images to one, which needs few programs."""
    tiny = tuple(scene for scene in golden.scenes() if scene.name == "tiny_table")
    monkeypatch.setattr(golden, "scenes", lambda: tiny)


@pytest.fixture
def mutate(monkeypatch, tmp_path):
    """Return `mutate(before, after)`, which edits the source of every later kernel."""
    monkeypatch.setattr(strict, "_cache_folder", lambda: tmp_path)

    def edit(before, after):
        real = program.inline_source
        assert before in real("evidence/doctor.cl", {}), before
        monkeypatch.setattr(program, "inline_source", lambda *a: real(*a).replace(before, after))

    return edit


def has_double():
    return devices.choose_device().supports["double"] == "yes"


def found(lanes=8):
    return arithmetic.examine(Device(allow_inexact=True), "single", (lanes,))


def names(findings):
    return {finding.operation for finding in findings}


def test_the_default_device_is_fit():
    report = examine(devices.choose_device())
    assert report.reasons == []
    assert [p.precision for p in report.profiles] == ["single", "double"][: 1 + has_double()]
    assert all(p.lanes == arithmetic.LANES[p.precision] for p in report.profiles)
    assert all(p.options == {"EXACT_DIVIDE": 1, "EXACT_SQRT": 1} for p in report.profiles)
    assert not any(p.wrong or p.replaced or p.subnormals for p in report.profiles)
    assert report.fma == "fused" and report.num_golden == sum(
        has_double() or scene.settings.precision == "single" for scene in golden.scenes()
    )


@pytest.mark.parametrize("name", MUTATIONS)
def test_each_wrong_operation_is_named(mutate, name):
    """Mutation: `MUTATIONS[name]`, such as fma(a, c, b) for a * c + b, or fmax for comparison and select."""
    mutate(*MUTATIONS[name])
    wrong = found().wrong
    assert name in names(wrong)
    assert names(wrong) - {name} <= ({"dot"} if name == "sum" else set())
    assert all(0 < finding.num_wrong <= finding.num_tested and " gave " in finding.example for finding in wrong)


def test_a_row_that_the_device_does_not_write_is_wrong(mutate):
    """Mutation: no RESULT(multiply, ...) in doctor.cl."""
    mutate("RESULT(multiply, a * b);", "")
    assert names(found(1).wrong) == {"multiply"}


def test_flushed_subnormals_are_reported_but_no_failure(mutate):
    """Mutation: zero for products below the least normal number."""
    tiny = "MASK(magnitude(a * b) < FLT_MIN) & MASK(a * b != R(0.0))"
    mutate("RESULT(multiply, a * b)", f"RESULT(multiply, SELECT(a * b, R(0.0), {tiny}))")
    result = found()
    assert names(result.subnormals) == {"multiply"} and not result.wrong


@pytest.mark.parametrize(
    ("mutation", "operation", "option"), [(DIVISION, "divide", "EXACT_DIVIDE"), (ROOT, "square_root", "EXACT_SQRT")]
)
@pytest.mark.parametrize("lanes", [1, 8])
def test_a_wrong_division_or_root_is_replaced_by_ours(mutate, mutation, operation, option, lanes):
    """Mutations: a * (1 / b) for a / b; x * rsqrt(x) for sqrt(x)."""
    mutate(*mutation)
    result = found(lanes)
    assert not result.wrong and names(result.replaced) == {operation}
    assert result.options == {"EXACT_DIVIDE": 1, "EXACT_SQRT": 1} | {option: 0}


def test_a_wrong_replacement_is_a_failure(mutate):
    """Mutations: a * (1 / b) for a / b, and no last correction in the division of divide.h."""
    mutate(*DIVISION)
    mutate(
        "return step_ulp(q, MASK(remainder > half_ulp), MASK(remainder < -half_ulp));",
        "return within_binade(n * inverse);",
    )
    assert "divide" in names(found().wrong)


@pytest.mark.parametrize("every", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_images_do_not_depend_on_whose_division_and_root_it_is(mutate, every):
    """The golden images keep their hashes. Mutations: a * (1 / b) for a / b; x * rsqrt(x) for sqrt(x)."""
    mutate(*DIVISION)
    mutate("#define divide_real(a, b) ((a) / (b))", "#define divide_real(a, b) ((a) * (R(1.0) / (b)))")
    mutate(*ROOT)
    mutate("#define square_root_real(x) sqrt(x)", "#define square_root_real(x) ((x) * rsqrt(x))")
    renderer = splatcl.Renderer()
    assert renderer.device.strictness.options("single") == {"EXACT_DIVIDE": 0, "EXACT_SQRT": 0}
    more = MORE_GOLDEN + ("near_plane_double",) * has_double()
    assert golden.check(renderer, GOLDEN + more * every) == []
    frame = renderer.render(SPLATS, CAMERA)
    assert "inexact" not in frame.metadata


def test_relaxed_math_is_caught_by_its_arithmetic_too(monkeypatch, tiny_golden):
    """Mutation: the compiler flag -cl-fast-relaxed-math."""
    monkeypatch.setenv("PYOPENCL_BUILD_OPTIONS", "-cl-fast-relaxed-math")
    report = examine(devices.choose_device())
    assert report.reasons[0] == "PYOPENCL_BUILD_OPTIONS injects compiler flags"
    assert report.flags == {"PYOPENCL_BUILD_OPTIONS": "-cl-fast-relaxed-math"}
    assert "less" in names(report.profiles[0].wrong) or "rounding_of_sum" in names(report.profiles[0].wrong)


def test_a_wrong_device_is_refused_or_recorded(mutate, tmp_path):
    """Mutation: another order of the sum in dot products."""
    mutate(*MUTATIONS["dot"])
    with pytest.raises(DeviceError, match=r"computes wrongly: dot \(dot \(single, lanes 1\): .*see `splatcl doctor`"):
        splatcl.Renderer()
    frame = splatcl.Renderer(allow_inexact=True).render(SPLATS, CAMERA, CULL)
    assert "computes wrongly: dot" in frame.metadata["inexact"]
    frame.save(tmp_path / "frame.exr")
    assert read_exr(tmp_path / "frame.exr")[2]["inexact"] == frame.metadata["inexact"]


def test_double_precision_is_judged_when_it_is_used(mutate):
    """Mutation: another order of the sum in dot products, in double precision alone."""
    if not has_double():
        pytest.skip("the device has no double precision")
    before, after = MUTATIONS["dot"]
    mutate(before, f"if (DOUBLE) {after} else {before}")
    renderer = splatcl.Renderer()
    renderer.render(SPLATS, CAMERA, CULL)
    with pytest.raises(DeviceError, match=r"computes wrongly: dot \(dot \(double"):
        renderer.render(SPLATS, CAMERA, splatcl.RenderSettings(precision="double"))


@pytest.mark.parametrize("variable", strict.FLAG_VARIABLES)
def test_injected_flags_are_recorded_where_they_are_allowed(monkeypatch, tmp_path, capsys, variable):
    monkeypatch.setenv(variable, "-cl-mad-enable")
    cloud = tmp_path / "cloud.xyz"
    cloud.write_text("".join(f"{x} {y} 0\n" for x in range(4) for y in range(4)))
    command = ["render", str(cloud), "-o", str(tmp_path / "out.exr"), "--size", "20x20"]
    assert main(command) == 2
    assert f"{variable} injects compiler flags" in capsys.readouterr().err
    assert not (tmp_path / "out.exr").exists()
    assert main([*command, "--allow-inexact"]) == 0
    expected = f"{variable} injects compiler flags, which can change an image: -cl-mad-enable"
    assert f"note: inexact: {expected}" in capsys.readouterr().out
    assert read_exr(tmp_path / "out.exr")[2]["inexact"] == expected


def test_the_quick_test_is_remembered(mutate, monkeypatch, tmp_path):
    """The test runs again where the cache is damaged or cannot be written."""
    device, calls = Device(), []
    real = arithmetic.examine
    monkeypatch.setattr(arithmetic, "examine", lambda *a: calls.append(a) or real(*a))
    first = strict.quick_test(device, "single")
    assert strict.quick_test(device, "single") == first and len(calls) == 1
    (path,) = tmp_path.iterdir()
    path.write_text('{"precision": "sing')
    assert strict.quick_test(device, "single") == first and len(calls) == 2
    path.write_text("[]")
    assert strict.quick_test(device, "single") == first and len(calls) == 3
    monkeypatch.setattr(strict, "_cache_folder", lambda: path / "not_a_folder")
    assert strict.quick_test(device, "single") == first and len(calls) == 4


def test_the_memory_belongs_to_one_test_on_one_device(mutate, monkeypatch):
    device = Device()
    keys = {strict._key(device, precision, (1, 8)) for precision in ("single", "double")}
    keys.add(strict._key(device, "single", (1,)))
    monkeypatch.setenv("POCL_EXTRA_BUILD_FLAGS", "-O1")
    keys.add(strict._key(device, "single", (1, 8)))
    mutate(*DIVISION)
    keys.add(strict._key(device, "single", (1, 8)))
    device.info = replace(device.info, version="another")
    keys.add(strict._key(device, "single", (1, 8)))
    assert len(keys) == 6


def test_the_command_line_reports(mutate, capsys, monkeypatch, tiny_golden):
    """The exit status is 1 for a wrong device. Mutation: another order of the sum in dot products."""
    monkeypatch.setattr(arithmetic, "THOROUGH", arithmetic.QUICK)
    assert main(["doctor"]) == 0
    out = capsys.readouterr().out
    assert "fit for reference renders" in out and "all 1 images match" in out
    mutate(*MUTATIONS["dot"])
    assert main(["doctor"]) == 1
    out = capsys.readouterr().out
    assert "NOT strict" in out and "unfit: single precision: dot wrong" in out
    assert main(["doctor", "--json", "--all"]) == 1
    reports = json.loads(capsys.readouterr().out)
    assert len(reports) == len(devices.list_devices())
    assert not reports[0]["fit"] and reports[0]["profiles"][0]["wrong"][0]["operation"] == "dot"
    assert reports[0]["golden"]["mismatches"]


def test_the_documentation_shows_the_report_of_a_healthy_device():
    """The counts of operations, numbers and golden images are current; the page names its own device and runtime."""
    example = re.search(r"```console\n\$ splatcl doctor\n(.*?)```", PAGE, re.DOTALL)
    assert example
    index, name, platform, version = re.match(r"(\d+)  (.+)\n   ([^,\n]+), (.+)\n", example[1]).groups()
    device = replace(devices.choose_device(), index=int(index), name=name, platform=platform, version=version)
    profiles = tuple(
        arithmetic.Arithmetic(precision, lanes, arithmetic.THOROUGH) for precision, lanes in arithmetic.LANES.items()
    )
    report = Report(device, "", profiles, "fused", {}, len(golden.scenes()))
    assert list(report.lines()) == example[1].splitlines()
    assert f"tests {arithmetic.QUICK} numbers" in PAGE


KERNELS = files("splatcl.kernels")
INTEGER_DIVISORS = r"(?:(?:BLOCK|(?:PAIR_)?REGION)S?(?:_[XY])?|TILE|LANES|tiles_x|width)\b"


@pytest.mark.parametrize(
    "path", sorted(str(p.relative_to(KERNELS)) for p in KERNELS.rglob("*") if p.suffix in (".h", ".cl"))
)
def test_kernels_divide_and_take_roots_by_our_names(path):
    """Kernels call divide and square_root of divide.h. Mutation: `a / b` or `sqrt(a)` of reals in any kernel."""
    code = re.sub(r"//.*", "", (KERNELS / path).read_text())
    code = re.sub(r"#define (?:divide|square_root)\w*\(.*", "", code)
    assert not re.findall(r"\bsqrt\(.*", code)
    assert not re.findall(rf".* /=? (?!\(?{INTEGER_DIVISORS}).*", code)
