"""splatcl: the reference software rasterizer for surface splatting, in OpenCL, driven from Python.

A public name is imported at its first use, so that ``import splatcl`` and ``splatcl --help`` start fast.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from splatcl import features as features
    from splatcl.errors import SplatclError
    from splatcl.frame import Frame, read_frame
    from splatcl.io.read import read
    from splatcl.io.write import write
    from splatcl.prepare.decimate import decimate
    from splatcl.prepare.normal_fields import fit_normal_fields, normal_fields
    from splatcl.renderer import Renderer, render
    from splatcl.scene.camera import Camera
    from splatcl.scene.lights import Light, Material, Npr, environment_lights
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
    "environment_lights",
    "fit_normal_fields",
    "normal_fields",
    "read",
    "read_frame",
    "render",
    "write",
]
_MODULES = {
    "Camera": "scene.camera",
    "Frame": "frame",
    "Light": "scene.lights",
    "Material": "scene.lights",
    "Npr": "scene.lights",
    "RenderSettings": "scene.settings",
    "Renderer": "renderer",
    "SplatclError": "errors",
    "Splats": "scene.splats",
    "decimate": "prepare.decimate",
    "environment_lights": "scene.lights",
    "fit_normal_fields": "prepare.normal_fields",
    "normal_fields": "prepare.normal_fields",
    "read": "io.read",
    "read_frame": "frame",
    "render": "renderer",
    "write": "io.write",
}


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
