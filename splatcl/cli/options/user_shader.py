"""``--user-shader``: a file of OpenCL C that colors each pixel."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from splatcl.cli.options.groups import SETTINGS
from splatcl.errors import FileError, SettingsError
from splatcl.scene.settings import RenderSettings

UserShaderOption = Annotated[
    Path | None,
    Parameter(
        group=SETTINGS,
        parse=True,
        help="File of OpenCL C with a function float4 shade(const Surface s, const Scene scene) "
        "(docs/guide/shaders.md). It sets --shader user.",
    ),
]


def user_shader_changes(file: Path | None, shader: str | None) -> dict[str, Any]:
    """Return the settings that the file of ``--user-shader`` gives.

    Parameters
    ----------
    file : path, optional
        None where the option is absent.
    shader : str, optional
        Value of ``--shader``, None where it is absent.
    """
    if file is None:
        return {}
    if shader not in (None, "user"):
        raise SettingsError(f"--user-shader and --shader {shader} cannot be combined; remove one")
    try:
        text = file.read_text(encoding="utf-8")
    except OSError as error:
        raise FileError(f"{file}: cannot read: {error.strerror or error}") from error
    except ValueError:
        raise FileError(f"{file}: cannot read: the text must be UTF-8; convert it") from None
    return {"shader": "user", "user_shader": text, "user_shader_name": str(file)}


def with_user_shader(settings: RenderSettings, file: Path | None) -> RenderSettings:
    """Return the settings of ``splatcl render`` with the shader of ``--user-shader``."""
    if file is None and settings.shader == "user":
        raise SettingsError("--shader user needs --user-shader FILE.cl")
    shader = None if settings.shader == RenderSettings().shader else settings.shader
    return replace(settings, **user_shader_changes(file, shader))
