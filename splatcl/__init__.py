"""splatcl: the reference software rasterizer for surface splatting, in OpenCL, driven from Python."""

from importlib.metadata import version

from splatcl.camera import Camera
from splatcl.errors import SplatclError
from splatcl.frame import Frame
from splatcl.io import read, write
from splatcl.lights import Light, Material
from splatcl.render import Renderer, render
from splatcl.settings import RenderSettings
from splatcl.splats import Splats

__version__ = version("splatcl")
__all__ = [
    "Camera",
    "Frame",
    "Light",
    "Material",
    "RenderSettings",
    "Renderer",
    "SplatclError",
    "Splats",
    "read",
    "render",
    "write",
]
