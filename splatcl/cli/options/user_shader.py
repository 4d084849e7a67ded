"""A user's shader file of the command line."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from splatcl.errors import FileError, SettingsError
from splatcl.scene.settings import RenderSettings


def user_changes(file: Path, shader: str | None) -> dict[str, Any]:
    """Return the settings that a user's shader file means, with `shader` as given besides."""
    if shader not in (None, "user"):
        raise SettingsError(f"--user-shader and --shader {shader} exclude each other")
    try:
        text = file.read_text(encoding="utf-8")
    except OSError as error:
        raise FileError(f"{file}: cannot read: {error.strerror or error}") from error
    except ValueError:
        raise FileError(f"{file}: not a text in UTF-8") from None
    return {"shader": "user", "user_shader": text, "user_shader_name": str(file)}


def with_user_shader(settings: RenderSettings, file: Path | None) -> RenderSettings:
    """Return the settings of ``splatcl render`` with the shader of a file."""
    if file is not None:
        shader = None if settings.shader == RenderSettings().shader else settings.shader
        return replace(settings, **user_changes(file, shader))
    if settings.shader == "user":
        raise SettingsError("--shader user needs --user-shader FILE.cl")
    return settings
