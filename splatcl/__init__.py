"""splatcl: the reference software rasterizer for surface splatting, in OpenCL, driven from Python.

Names are imported when they are first used, so that ``import splatcl`` and ``splatcl --help`` cost next to nothing.
"""

import importlib
import sys
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from splatcl import features
    from splatcl.scene.camera import Camera
    from splatcl.prepare.decimate import decimate
    from splatcl.errors import SplatclError
    from splatcl.prepare.normal_fields import fit_normal_fields, normal_fields
    from splatcl.frame import Frame
    from splatcl.io.read import read
    from splatcl.io.write import write
    from splatcl.frame import read_frame
    from splatcl.scene.lights import Light, Material, Npr
    from splatcl.renderer import Renderer, render
    from splatcl.scene.settings import RenderSettings
    from splatcl.scene.splats import Splats

    __version__: str

__all__ = [
    "Camera",
    "Frame",
    "Light",
    "Material",
    "Npr",
    "RenderSettings",
    "Renderer",
    "SplatclError",
    "Splats",
    "decimate",
    "fit_normal_fields",
    "normal_fields",
    "read",
    "read_frame",
    "render",
    "write",
]
_MODULES = {
    "Camera": "camera",
    "Frame": "frame",
    "Light": "lights",
    "Material": "lights",
    "Npr": "lights",
    "RenderSettings": "settings",
    "Renderer": "render",
    "SplatclError": "errors",
    "Splats": "splats",
    "decimate": "decimate",
    "fit_normal_fields": "fields",
    "normal_fields": "fields",
    "read": "io",
    "read_frame": "io.frames",
    "render": "render",
    "write": "io",
}


class _Package(ModuleType):
    """The package: importing a module `render` or `decimate` binds that name, which shall stay the function."""

    def __setattr__(self, name: str, value: Any) -> None:
        if name in ("decimate", "render") and isinstance(value, ModuleType):
            value = getattr(value, name)
        super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        value: Any = version("splatcl")
    elif name == "features":
        value = importlib.import_module("splatcl.features")
    elif name in _MODULES:
        value = getattr(importlib.import_module(f"splatcl.{_MODULES[name]}"), name)
    else:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__, "__version__"})
