"""``RenderSettings`` as options, with the help of its docstring."""

from __future__ import annotations

from typing import Annotated

from cyclopts import Parameter

from splatcl.cli.options.groups import SETTINGS
from splatcl.scene.settings import RenderSettings

SettingsOptions = Annotated[RenderSettings | None, Parameter(name="*", group=SETTINGS)]
