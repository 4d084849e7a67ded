"""The kernels' sources: includes go down, every header compiles alone, names tell the file and mean one thing."""

from __future__ import annotations

import re
from collections import defaultdict
from graphlib import CycleError, TopologicalSorter
from importlib.resources import files

import pytest

from splatcl.errors import DeviceError
from splatcl.opencl.device import program
from splatcl.opencl.device import structs as layout
from splatcl.opencl.device.program import INCLUDE, Program, file_of

FOLDERS = ("arithmetic", "splat", "projection", "shading", "passes", "evidence", "bench")
"""Folders in order: a file includes only headers of its own folder and of earlier folders."""
KERNELS = files("splatcl.kernels")
SOURCES = {str(p.relative_to(KERNELS)): p.read_text() for p in KERNELS.rglob("*") if p.suffix in (".h", ".cl")}
HEADERS = sorted(path for path in SOURCES if path.endswith(".h"))
SHADERS = [path for path in HEADERS if path.startswith("shading/shaders/")]
INTERFACE = {"shade_surface", "shade_pixels", "TAKES_PIXELS"}
"""Names that several shaders define; a program holds one shader."""

PLAIN = {
    "LANES": 8, "DOUBLE": 0, "ON_POCL": 0, "EXACT_DIVIDE": 1, "EXACT_SQRT": 1, "TILE": 16, "REGION": 16,
    "ORTHOGRAPHIC": 0, "CENTER_LOW": 0, "ELLIPSE": 0, "PREFILTER": 1, "CLIP": 0, "FIELD": 0, "GLOSS": 0, "SHADING": 0,
    "SHADER": '"shading/shaders/albedo.h"', "KERNEL": 0, "TARGET": 0, "CHANNELS": 0, "LAYER": 0, "RESOLVED": 0,
    "SHADOWS": 0, "LIGHTMAP": 3, "TABLE_TEXTURE": 0, "TABLE_OVER_R2": 0, "STRICT_EPSILON": 0, "FILTER_DEPTH": 0,
}  # fmt: skip
RICH = PLAIN | {
    "LANES": 4, "DOUBLE": 1, "EXACT_DIVIDE": 0, "EXACT_SQRT": 0, "ORTHOGRAPHIC": 1, "CENTER_LOW": 1, "ELLIPSE": 2,
    "PREFILTER": 2, "CLIP": 1, "FIELD": 1, "GLOSS": 1, "SHADER": '"shading/shaders/phong.h"', "KERNEL": 3, "TARGET": 2,
    "CHANNELS": 1, "LAYER": 2, "RESOLVED": 1, "TABLE_TEXTURE": 1, "TABLE_OVER_R2": 1, "STRICT_EPSILON": 1,
    "FILTER_DEPTH": 2,
}  # fmt: skip


def included(text):
    """Return the headers that a text includes; `#include SHADER` stands for all shaders."""
    found = [INCLUDE.fullmatch(line) for line in text.splitlines()]
    return [path for m in found if m for path in ([m[1]] if m[1] else SHADERS if m[2] == "SHADER" else [])]


def not_down(sources):
    """Return the includes of files that are no headers or lie in a later folder."""
    floor = {folder: i for i, folder in enumerate(FOLDERS)}
    includes = [(path, header) for path, text in sources.items() for header in included(text)]
    return [
        f"{path}: {header}"
        for path, header in includes
        if not header.endswith(".h") or floor[header.split("/")[0]] > floor[path.split("/")[0]]
    ]


def conditional(text):
    """Return the includes between #if and #endif."""
    depth, found = 0, []
    for line in text.splitlines():
        depth += line.startswith("#if") - line.startswith("#endif")
        found += [line] * bool(depth and INCLUDE.fullmatch(line))
    return found


def defined(text):
    """Return the names that a text defines at file scope."""
    code = re.sub(r"//.*", "", text)
    functions = re.findall(r"^(?:static|INLINE|CALLED|kernel)\b[^;{(]*?(\w+)\([^;]*?\n?\{", code, re.M)
    types = re.findall(r"^(?:typedef struct \{.*)?\} (?:__attribute__\(\(.*\)\) )?(\w+);", code, re.M)
    return {*functions, *types, *re.findall(r"^#define (\w+)", code, re.M)}


def build(device, header, options):
    real = "f8" if options["DOUBLE"] else "f4"
    return Program(device.context, header, layout.structs(real)[1], options)


def test_includes_go_down():
    assert not_down(SOURCES) == []


def test_there_is_no_circle_of_includes():
    list(TopologicalSorter({path: included(text) for path, text in SOURCES.items()}).static_order())


def test_an_include_that_goes_up_is_seen():
    assert not_down({"splat/disc.h": '#include "shading/light.h"'}) == ["splat/disc.h: shading/light.h"]
    assert not_down({"evidence/probe.cl": '#include "passes/bin.cl"'}) == ["evidence/probe.cl: passes/bin.cl"]
    circle = {"splat/disc.h": included('#include "splat/extra.h"'), "splat/extra.h": included(SOURCES["splat/extra.h"])}
    with pytest.raises(CycleError):
        list(TopologicalSorter(circle).static_order())


def test_no_include_is_conditional():
    """The loader takes each file once, so a later include may not depend on a skipped one."""
    assert {path: found for path, text in SOURCES.items() if (found := conditional(text))} == {}
    assert conditional('#if FIELD\n#include "splat/disc.h"\n#endif\n#include SHADER') == ['#include "splat/disc.h"']


@pytest.mark.parametrize("header", HEADERS)
def test_a_header_compiles_alone(device, header):
    """One set of options has the branches of the default method, the other set has the branches of other methods."""
    choices = [RICH] if header.startswith("evidence/") else [PLAIN, RICH]
    for options in choices:
        if options["DOUBLE"] and device.info.supports["double"] != "yes":
            pytest.skip("no double precision")
        build(device, header, options)
    if header.startswith("shading/") and header != "shading/shaders/lightmap.h":
        build(device, header, PLAIN | {"SHADOWS": 1, "LIGHTMAP": 0})


def test_a_header_without_its_includes_does_not_compile(device, monkeypatch):
    lines = [line for line in SOURCES["splat/ray.h"].splitlines() if not INCLUDE.fullmatch(line)]
    monkeypatch.setattr(program, "_lines", lambda file: lines)
    with pytest.raises(DeviceError, match=r"kernels/splat/ray\.h does not build"):
        build(device, "splat/ray.h", PLAIN)


@pytest.mark.parametrize("path", [path for path in SOURCES if path.endswith(".cl")])
def test_a_kernel_is_named_as_its_file(path):
    kernels = re.findall(r"^kernel void (\w+)", SOURCES[path], re.M)
    assert kernels and {file_of(kernel) for kernel in kernels} == {path}


def test_no_name_has_two_meanings():
    where = defaultdict(list)
    for path, text in SOURCES.items():
        for name in defined(text) - INTERFACE:
            where[name].append(path)
    assert {name: paths for name, paths in where.items() if len(paths) > 1} == {}
    assert len(where) > 400 and where["bin_count"] == ["passes/bin.cl"] and where["discs"] == ["splat/disc.h"]


@pytest.mark.parametrize("header", HEADERS)
def test_a_header_says_what_it_provides(header):
    assert SOURCES[header].startswith("// Provides ")
