"""A user's shader (kernels/passes/user_shader.cl): the text it is compiled with, and what is said of its errors."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from splatcl.errors import SettingsError
from splatcl.lighting import light_options
from splatcl.program import BuildError, Text
from splatcl.settings import RenderSettings

if TYPE_CHECKING:
    from splatcl.passes import Passes
    from splatcl.shading import Channels

MAX_ERRORS = 3
"""First errors of a build that are told."""
SIGNATURE = "float4 shade(const Surface s, const Scene scene)"
ERROR = re.compile(
    r"^(?=.*error: )(?:(?:fatal )?error: )?(?P<file>.+?):(?P<line>\d+):\d+: (?:(?:fatal )?error: )?(?P<text>.*)$", re.M
)
"""An error of a build log: PoCL puts the word before the place, others after it."""


def run(passes: Passes, channels: Channels, light: tuple[Any, ...], *args: Any, color: Any) -> None:
    """Run the settings' shader over the image.

    Parameters
    ----------
    passes : Passes
    channels : mapping
        What the frame has besides, which becomes the fields of ``s.attribute``.
    light : tuple
        What comes with the lights (`lighting.light_arguments`).
    *args, color
        Of the kernel.

    Raises
    ------
    SettingsError
        There is no shader's text, it has no function ``shade``, or it does not compile.
    """
    settings, size = passes.settings, (passes.camera.width, passes.camera.height)
    images = list(dict.fromkeys(image for image, _ in channels.values()))
    places = {name: (images.index(image), k) for name, (image, k) in channels.items()}
    try:
        passes.run(
            "user_shader", size, *args, color, *images, *light, LANES=1, RESOLVED=1, **light_options(settings),
            ATTRIBUTES=Text(_declarations(places, len(images))), USER_SHADER=Text(_code(settings)),
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


def _declarations(places: Mapping[str, tuple[int, int]], num_images: int) -> str:
    """Declare the struct of the attributes, and how they are read at a pixel: from which image and channel."""
    fields = " ".join(f"float {name};" for name in places)
    reads = " ".join(f"a.{name} = (float)channels_{i}[3 * p + {k}];" for name, (i, k) in places.items())
    arguments = "".join(f", global const real *channels_{i}" for i in range(num_images))
    names = "".join(f", channels_{i}" for i in range(num_images))
    return (
        f"#define ATTRIBUTE_ARGUMENTS {arguments}\n"
        f"#define ATTRIBUTES_AT(p) attributes_at(p{names})\n"
        '#line 1 "attributes of the frame"\n'
        f"typedef struct {{ int num_attributes_; {fields} }} Attributes;\n"
        f"static inline Attributes attributes_at(long p{arguments})\n"
        f"{{ Attributes a; a.num_attributes_ = {len(places)}; {reads} return a; }}"
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
