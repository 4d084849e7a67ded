"""A user's shader (kernels/passes/user_shader.cl): the source around it, and its compile errors in the user's lines."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from splatcl.errors import SettingsError
from splatcl.opencl.device.program import BuildError, Text
from splatcl.opencl.state.buffers import Channels
from splatcl.opencl.state.context import PassContext
from splatcl.opencl.state.lights import light_options
from splatcl.scene.settings import RenderSettings

MAX_ERRORS = 3
"""Most compile errors in a message; it counts the rest."""
SIGNATURE = "float4 shade(const Surface s, const Scene scene)"
ERROR = re.compile(
    r"^(?=.*error: )(?:(?:fatal )?error: )?(?P<file>.+?):(?P<line>\d+):\d+: (?:(?:fatal )?error: )?(?P<text>.*)$", re.M
)
"""An error of a build log: PoCL writes "error:" before the file and line, other runtimes after them."""


def user_shader(context: PassContext, channels: Channels, light: tuple[Any, ...], *args: Any, color: Any) -> None:
    """Run the settings' shader over the image, once per pixel.

    Parameters
    ----------
    context : PassContext
    channels : mapping
        The splats' own attributes; they become the fields of ``s.attribute``.
    light : tuple
        The kernel's last arguments (`light_arguments`).
    *args
        The kernel's first arguments.
    color
        Buffer to fill, (H, W, 4) real linear RGBA.

    Raises
    ------
    SettingsError
        The settings have no shader, or it has no function ``shade``, or it does not compile.
    """
    settings, size = context.settings, (context.camera.width, context.camera.height)
    images = list(dict.fromkeys(image for image, _ in channels.values()))
    channel_of = {name: (images.index(image), k) for name, (image, k) in channels.items()}
    try:
        context.run(
            "user_shader", size, *args, color, *images, *light, LANES=1, RESOLVED=1, **light_options(settings),
            ATTRIBUTES=Text(_declarations(channel_of, len(images))), USER_SHADER=Text(_code(settings)),
        )  # fmt: skip
    except BuildError as error:
        raise build_error(str(error), settings) from None


def _code(settings: RenderSettings) -> str:
    name, code = settings.user_shader_name, settings.user_shader
    if not code:
        raise SettingsError(f"shader='user' needs user_shader; set it to OpenCL C with a function {SIGNATURE}")
    if not re.search(r"\bshade\s*\(", code):
        raise SettingsError(f"{name}: has no function {SIGNATURE}")
    return f"#line 1 {_quoted(name)}\n{code}"


def _declarations(channel_of: Mapping[str, tuple[int, int]], num_images: int) -> str:
    """Return OpenCL C that declares the struct of the attributes, and reads it at a pixel.

    `channel_of` has the index of each attribute's image and its channel.
    """
    fields = " ".join(f"float {name};" for name in channel_of)
    reads = " ".join(f"a.{name} = (float)channels_{i}[3 * p + {k}];" for name, (i, k) in channel_of.items())
    arguments = "".join(f", global const real *channels_{i}" for i in range(num_images))
    names = "".join(f", channels_{i}" for i in range(num_images))
    return (
        f"#define ATTRIBUTE_ARGUMENTS {arguments}\n"
        f"#define ATTRIBUTES_AT(p) attributes_at(p{names})\n"
        '#line 1 "attributes of the frame"\n'
        f"typedef struct {{ int num_attributes_; {fields} }} Attributes;\n"
        f"static inline Attributes attributes_at(long p{arguments})\n"
        f"{{ Attributes a; a.num_attributes_ = {len(channel_of)}; {reads} return a; }}"
    )


def _quoted(name: str) -> str:
    escaped = re.sub(r'[\\"]', r"\\\g<0>", name)
    return f'"{re.sub(r"[^ -~]", "_", escaped)}"'


def build_error(log: str, settings: RenderSettings) -> SettingsError:
    """Return an error with the first errors of a build log, each with the user's file and line."""
    name = settings.user_shader_name
    own, ours = [], []  # errors in the user's file, and in the kernels that include it
    for found in ERROR.finditer(log):
        if found["file"].startswith("kernels/"):
            ours.append(f"{name}: must define {SIGNATURE} ({found['text']})")
        else:
            own.append(f"{found['file']}:{found['line']}: {found['text']}")
    errors = list(dict.fromkeys(own or ours)) or [f"{name}: does not compile: {' '.join(log.split())}"]
    more = f" (and {len(errors) - MAX_ERRORS} more)" if len(errors) > MAX_ERRORS else ""
    return SettingsError("; ".join(errors[:MAX_ERRORS]) + more)
