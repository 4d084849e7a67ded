"""A user's shader (kernels/user.cl): the text it is compiled with, and what is said of its errors."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from splatcl.errors import SettingsError
from splatcl.program import BuildError, Text
from splatcl.settings import RenderSettings

if TYPE_CHECKING:
    from splatcl.passes import Passes

MAX_ERRORS = 3
"""First errors of a build that are told."""
SIGNATURE = "float4 shade(const Surface s, const Scene scene)"
ERROR = re.compile(
    r"^(?=.*error: )(?:(?:fatal )?error: )?(?P<file>.+?):(?P<line>\d+):\d+: (?:(?:fatal )?error: )?(?P<text>.*)$", re.M
)
"""An error of a build log: PoCL puts the word before the place, others after it."""


def run(passes: Passes, attributes: Sequence[str], *args: Any) -> None:
    """Run the settings' shader over the image.

    Parameters
    ----------
    passes : Passes
    attributes : sequence of str
        Names of what the frame has besides, which become the fields of ``s.attribute``.
    *args
        Of the kernel.

    Raises
    ------
    SettingsError
        There is no shader's text, it has no function ``shade``, or it does not compile.
    """
    settings, camera = passes.settings, passes.camera
    try:
        passes.run(
            "user", (camera.width, camera.height), *args, LANES=1, RESOLVED=1,
            ATTRIBUTES=Text(_declarations(attributes)), USER_SHADER=Text(_code(settings)),
        )  # fmt: skip
    except BuildError as error:
        raise build_error(str(error), settings) from None


def _code(settings: RenderSettings) -> str:
    name, code = settings.user_shader_name, settings.user_shader
    if not code:
        raise SettingsError(f"shader='user' needs user_shader: OpenCL C of a function {SIGNATURE}")
    if not re.search(r"\bshade\s*\(", code):
        raise SettingsError(f"{name}: no function {SIGNATURE}")
    return f"#line 1 {_quoted(name)}\n{code}"


def _declarations(attributes: Sequence[str]) -> str:
    """Declare the struct of the attributes, and a function that reads them at a pixel."""
    fields = " ".join(f"float {name};" for name in attributes)
    reads = " ".join(f"a.{name} = (float)planes[p + {i} * stride];" for i, name in enumerate(attributes))
    return (
        '#line 1 "attributes of the frame"\n'
        f"typedef struct {{ int num_attributes_; {fields} }} Attributes;\n"
        "static inline Attributes attributes_at(global const real *planes, long p, long stride)\n"
        f"{{ Attributes a; a.num_attributes_ = {len(attributes)}; {reads} return a; }}"
    )


def _quoted(name: str) -> str:
    escaped = re.sub(r'[\\"]', r"\\\g<0>", name)
    return f'"{re.sub(r"[^ -~]", "_", escaped)}"'


def build_error(log: str, settings: RenderSettings) -> SettingsError:
    """Return the error that tells the first errors of a build log, each with the user's file and line."""
    name = settings.user_shader_name
    own, ours = [], []
    for found in ERROR.finditer(log):
        if found["file"].startswith("kernels/"):
            ours.append(f"{name}: it must define {SIGNATURE} ({found['text']})")
        else:
            own.append(f"{found['file']}:{found['line']}: {found['text']}")
    told = list(dict.fromkeys(own or ours)) or [f"{name}: does not compile: {' '.join(log.split())}"]
    more = f" (and {len(told) - MAX_ERRORS} more)" if len(told) > MAX_ERRORS else ""
    return SettingsError("; ".join(told[:MAX_ERRORS]) + more)
