"""OpenCL programs: a kernel file with its headers inlined, built for one device."""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from typing import Any

from splatcl.errors import DeviceError

PRAGMAS = """\
#pragma OPENCL FP_CONTRACT OFF
#ifdef __clang__  // PoCL 3.1 warns of each function with vectors wider than the CPU's
#pragma clang diagnostic ignored "-Wpsabi"
#endif
"""
"""Start of every program; it forbids fusing a product with a sum."""
INCLUDE = re.compile(r'#include (?:"(.+)"|(\w+))')
"""A header by its path below kernels/, or by the build option that names it."""


class BuildError(DeviceError):
    """A program that does not build; the message ends with the compiler's log."""


class Text(str):
    """A build option whose value is the text of a header."""


class Program:
    """Kernels of one source file, built with one set of options."""

    def __init__(self, context: Any, name: str, prelude: str, options: Mapping[str, str | int]) -> None:
        import pyopencl as cl

        defines = "".join(f"#define {key} {value}\n" for key, value in options.items() if not isinstance(value, Text))
        source = f"{PRAGMAS}{defines}{prelude}\n{inline_source(name, options)}"
        try:
            program = cl.Program(context, source).build(options=_rounding_options(context.devices[0]))
        except cl.RuntimeError as error:
            raise BuildError(f"kernels/{name} does not build on this device:\n{error}") from None
        self.kernels = {kernel.function_name: kernel for kernel in program.all_kernels()}

    def __call__(self, queue: Any, name: str, size: tuple[int, ...], group: int, *args: Any) -> None:
        """Run kernel `name` over `size` work-items; do nothing if a size is 0.

        A one-dimensional size comes in groups of `group`; the runtime chooses the groups of a two-dimensional one.
        """
        if all(size):
            self.kernels[name](queue, size, (group,) if len(size) == 1 else None, *args)


def _rounding_options(device: Any) -> list[str]:
    """Return the option for correctly rounded division and square root, if the device supports it."""
    import pyopencl as cl

    supported = device.single_fp_config & cl.device_fp_config.CORRECTLY_ROUNDED_DIVIDE_SQRT
    return ["-cl-fp32-correctly-rounded-divide-sqrt"] if supported else []


def file_of(kernel: str) -> str:
    """Return the source of `kernel`, which is named as its file or begins with that name: bin_count is in bin.cl."""
    words, paths = kernel.split("_"), _sources()
    names = ("_".join(words[:num]) for num in range(len(words), 0, -1))
    return next(paths[name] for name in names if name in paths)


@cache
def _sources() -> dict[str, str]:
    """Return the path below kernels/ of every .cl file, by its name."""
    folders = (folder for folder in files("splatcl.kernels").iterdir() if folder.is_dir())
    names = ((folder.name, file.name) for folder in folders for file in folder.iterdir())
    return {name.removesuffix(".cl"): f"{folder}/{name}" for folder, name in names if name.endswith(".cl")}


@cache
def _lines(file: str) -> tuple[str, ...]:
    """Return the lines of kernels/`file`."""
    return tuple((files("splatcl.kernels") / file).read_text().splitlines())


def inline_source(name: str, options: Mapping[str, str | int]) -> str:
    """Return kernels/`name` with each header inlined once; #line keeps the real file and line in errors."""
    done: set[str] = set()

    def inline(file: str) -> str:
        if file in done:
            return ""
        done.add(file)
        lines = [f'#line 1 "kernels/{file}"']
        for number, line in enumerate(_lines(file), 1):
            include = INCLUDE.fullmatch(line)
            if include:
                header = include[1] or options[include[2]]
                text = header if isinstance(header, Text) else inline(str(header).strip('"'))
                lines += [text, f'#line {number + 1} "kernels/{file}"']
            else:
                lines.append(line)
        return "\n".join(lines)

    return inline(name)
