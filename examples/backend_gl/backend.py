"""Surface splatting in OpenGL 3.3: the three passes of [BHZK05], through EGL, on Mesa's llvmpipe.

This is an independent renderer with its own GLSL, written for OpenGL: points as large as the discs' projections, rays
intersected in the fragment shader, float render targets. It takes splatcl's splats, cameras and settings and returns
buffers in splatcl's conventions, so that the two can be compared. README.md lists the limits that OpenGL imposes.
"""

from __future__ import annotations

import ctypes
import math
import os
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import moderngl
import numpy as np
from numpy.typing import NDArray

import splatcl
from splatcl.errors import CameraError, DeviceError, SettingsError

FOLDER = Path(__file__).parent
VERSION = "#version 330\n"
CHOICES = ("KEEP", "FLIP", "CULL", "PHONG", "ALBEDO", "NORMAL")
"""Names in the shaders of the values of FACING and SHADER."""
TEXTURE_2D, DEPTH_COMPONENT, DEPTH_COMPONENT32F, FLOAT = 0x0DE1, 0x1902, 0x8CAC, 0x1406
Defines = dict[str, str | int]
"""Preprocessor names that choose a variant of the shaders."""


@cache
def context() -> moderngl.Context:
    """Return the process's OpenGL context, without a window, in software unless the environment says otherwise.

    Raises
    ------
    DeviceError
        EGL, or a driver with OpenGL 3.3, is missing.
    """
    os.environ.setdefault("EGL_PLATFORM", "surfaceless")
    os.environ.setdefault("LIBGL_ALWAYS_SOFTWARE", "1")
    libraries = {"libegl": "libEGL.so.1", "libgl": "libEGL.so.1"}  # EGL finds every function, so libGL is not needed
    try:
        made = moderngl.create_context(require=330, standalone=True, backend="egl", **libraries)
    except Exception as error:  # moderngl has no exception class of its own
        raise DeviceError(f"no OpenGL 3.3 through EGL ({error}); install libegl1 and libgl1-mesa-dri") from None
    made.gc_mode = "auto"
    return made


@cache
def largest_point() -> float:
    """Return the largest point size, pixels."""
    return float(context().info["GL_POINT_SIZE_RANGE"][1])


@dataclass(frozen=True, eq=False)
class Targets:
    """Render targets of one size. The depth is float, so that depths are rounded as float32."""

    depth: moderngl.Texture  # scaled eye z; 1 where no disc is hit
    color_sum: moderngl.Texture  # RGBA32F: sum of w color; of w
    normal_sum: moderngl.Texture  # RGBA32F: sum of w normal, eye space; of w z, scaled
    color: moderngl.Texture  # RGBA32F: shaded
    visibility: moderngl.Framebuffer
    attributes: moderngl.Framebuffer
    shading: moderngl.Framebuffer

    @classmethod
    def of_size(cls, width: int, height: int) -> Targets:
        """Allocate the targets."""
        depth = depth_texture(width, height)
        color_sum, normal_sum, color = (context().texture((width, height), 4, dtype="f4") for _ in range(3))
        visibility = context().framebuffer((), depth)  # no color attachment: the pass writes depth alone
        attributes = context().framebuffer((color_sum, normal_sum), depth)
        attributes.depth_mask = False
        return cls(depth, color_sum, normal_sum, color, visibility, attributes, context().framebuffer((color,)))


def depth_texture(width: int, height: int) -> moderngl.Texture:
    """Return a depth texture of 32-bit floats; moderngl alone makes 24-bit integers."""
    texture = context().depth_texture((width, height))
    texture.compare_func = ""  # read as numbers
    texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
    integer = ctypes.c_int
    bind = _gl("glBindTexture", ctypes.c_uint, ctypes.c_uint)
    allocate = _gl("glTexImage2D", ctypes.c_uint, *[integer] * 5, ctypes.c_uint, ctypes.c_uint, ctypes.c_void_p)
    bind(TEXTURE_2D, texture.glo)
    allocate(TEXTURE_2D, 0, DEPTH_COMPONENT32F, width, height, 0, DEPTH_COMPONENT, FLOAT, None)
    return texture


def _gl(name: str, *argument_types: Any) -> Any:
    """Return an OpenGL function that moderngl does not offer."""
    address = ctypes.CDLL("libEGL.so.1").eglGetProcAddress
    address.restype, address.argtypes = ctypes.c_void_p, [ctypes.c_char_p]
    return ctypes.CFUNCTYPE(None, *argument_types)(address(name.encode()))


def program(vertex: str, fragment: str, variant: Defines) -> moderngl.Program:
    """Return a variant of a program made of two shader files, compiled once."""
    return _compile(vertex, fragment, "".join(f"#define {name} {value}\n" for name, value in variant.items()))


@cache
def _compile(vertex: str, fragment: str, defines: str) -> moderngl.Program:
    choices = "".join(f"#define {name} {number}\n" for number, name in enumerate(CHOICES))
    head = VERSION + choices + defines + "#line 1\n"
    vertex_text, fragment_text = (head + (FOLDER / name).read_text() for name in (vertex, fragment))
    return context().program(vertex_shader=vertex_text, fragment_shader=fragment_text)


class Backend:
    """A renderer that uploads its splats once.

    Parameters
    ----------
    splats : splatcl.Splats
    sort : bool
        Upload the splats along a space-filling curve, so that the points of a tile lie together in llvmpipe's memory.
        Frames become faster, and only the rounding of sums changes.

    Attributes
    ----------
    renderer_name : str
        Name of the OpenGL renderer, such as "llvmpipe (LLVM 15.0.6, 256 bits)".

    Raises
    ------
    DeviceError
        OpenGL is missing.
    """

    def __init__(self, splats: splatcl.Splats, sort: bool = True) -> None:
        self.renderer_name = str(context().info["GL_RENDERER"])
        self._num_splats = len(splats)
        self._oriented = splats.oriented
        radius = splats.radius
        self._auto_epsilon = float(np.median(radius)) if len(splats) else 0.0
        self._largest_radius = float(radius.max(initial=0.0))
        self._sphere = splats.bounding_sphere
        rows = vertices(splats, self._sphere[0])
        rows = rows[morton_order(rows[:, :3])] if sort else rows
        self._buffer = context().buffer(rows.tobytes() or bytes(rows.itemsize * 12))
        self._vertex_arrays: dict[moderngl.Program, moderngl.VertexArray] = {}
        self._targets: Targets | None = None
        self._depth_scale = 1.0

    def draw(self, camera: splatcl.Camera, settings: splatcl.RenderSettings) -> None:
        """Render one frame and wait until it is done.

        Raises
        ------
        SettingsError, CameraError
            The OpenGL passes do not support a setting or the projection.
        """
        refuse_unsupported(camera, settings)
        if self._targets is None or self._targets.depth.size != (camera.width, camera.height):
            self._targets = Targets.of_size(camera.width, camera.height)
        targets, gl = self._targets, context()
        self._depth_scale, uniforms = self._uniforms(camera, settings)
        variants = self._variants(camera, settings)

        gl.enable_only(moderngl.PROGRAM_POINT_SIZE | moderngl.DEPTH_TEST)
        gl.depth_func = "<"
        targets.visibility.use()
        targets.visibility.clear(depth=1.0)
        for variant in variants:
            self._draw_splats("visibility.frag", variant, uniforms)

        gl.enable(moderngl.BLEND)
        gl.blend_func = moderngl.ONE, moderngl.ONE
        gl.depth_func = "<="
        targets.attributes.use()
        targets.attributes.clear(depth=1.0)
        for variant in variants:
            self._draw_splats("attributes.frag", {**variant, "ATTRIBUTES": 1}, uniforms)

        gl.enable_only(moderngl.NOTHING)
        targets.shading.use()
        for unit, texture in enumerate((targets.depth, targets.color_sum, targets.normal_sum)):
            texture.use(unit)
        self._draw_image({"SHADER": settings.shader.upper(), "NUM_LIGHTS": len(settings.lights)}, uniforms)
        gl.finish()

    def read(self) -> dict[str, NDArray[Any]]:
        """Return the last frame, with rows from the top and eye space with y down and z forward.

        Returns
        -------
        dict
            `color` (H, W, 4) linear RGBA; `Z` (H, W) eye-space z, +inf where no disc is hit; `weight` (H, W);
            `albedo`, `N` (H, W, 3); zero in empty pixels. All are float32.
        """
        assert self._targets, "draw() comes before read()"
        depth = _pixels(self._targets.depth)[..., 0]
        color_sum, normal_sum = _pixels(self._targets.color_sum), _pixels(self._targets.normal_sum)
        weight = color_sum[..., 3]
        length = np.linalg.norm(normal_sum[..., :3], axis=2)
        return {
            "color": _pixels(self._targets.color),
            "Z": np.where(depth < 1, depth / np.float32(self._depth_scale), np.float32(np.inf)),
            "weight": weight,
            "albedo": color_sum[..., :3] / np.where(weight > 0, weight, 1)[..., None],
            "N": normal_sum[..., :3] / np.where(length > 0, length, 1)[..., None],
        }

    def _draw_splats(self, fragment: str, variant: Defines, uniforms: dict[str, Any]) -> None:
        shaders = program("splat.vert", fragment, variant)
        if shaders not in self._vertex_arrays:
            names = [name for name in ("center", "tangent_u", "tangent_v", "color") if name in shaders]
            layout = "3f 3f 3f 3f" if "color" in names else "3f 3f 3f 12x"
            rate = " /i" if "QUADS" in variant else ""
            self._vertex_arrays[shaders] = context().vertex_array(shaders, [(self._buffer, layout + rate, *names)])
        _set(shaders, uniforms)
        if "QUADS" in variant:
            self._vertex_arrays[shaders].render(moderngl.TRIANGLE_STRIP, vertices=4, instances=self._num_splats)
        else:
            self._vertex_arrays[shaders].render(moderngl.POINTS, vertices=self._num_splats)

    def _draw_image(self, variant: Defines, uniforms: dict[str, Any]) -> None:
        shaders = program("shade.vert", "shade.frag", variant)
        if shaders not in self._vertex_arrays:
            self._vertex_arrays[shaders] = context().vertex_array(shaders, [])
        _set(shaders, uniforms)
        self._vertex_arrays[shaders].render(moderngl.TRIANGLES, vertices=3)

    def _variants(self, camera: splatcl.Camera, settings: splatcl.RenderSettings) -> list[Defines]:
        """Return the shader definitions of each draw call of a pass over the splats."""
        facing = settings.facing if self._oriented else "flip"
        points: Defines = {"FACING": facing.upper(), "PREFILTER": int(settings.prefilter == "min")}
        nearest, farthest = self._z_range(camera)
        if not camera.near < nearest <= farthest < camera.far:
            points["CUTS_DEPTH"] = 1
        # Two points of a disc inside the image are at most this far apart, in either direction.
        corner = (
            max(camera.cx, camera.width - camera.cx) / camera.fx,
            max(camera.cy, camera.height - camera.cy) / camera.fy,
        )
        diameter = 2 * self._largest_radius * max(camera.fx, camera.fy) * (1 + max(corner)) / max(nearest, camera.near)
        if max(diameter, 2 * settings.prefilter_radius) + 2 > largest_point():
            return [points, {**points, "QUADS": 1}]
        return [points]

    def _z_range(self, camera: splatcl.Camera) -> tuple[float, float]:
        """Return bounds of the eye-space z of all splats, scene units."""
        middle, radius = self._sphere
        z = float(camera.eye_from_world[2, :3] @ middle + camera.eye_from_world[2, 3])
        return z - 1.001 * radius, z + 1.001 * radius

    def _uniforms(self, camera: splatcl.Camera, settings: splatcl.RenderSettings) -> tuple[float, dict[str, Any]]:
        """Return the depth scale, and each uniform's value by its name."""
        rotation, translation = camera.eye_from_world[:3, :3], camera.eye_from_world[:3, 3]
        depth_scale = 2.0 ** -math.frexp(max(self._z_range(camera)[1], 1e-30))[1]
        depth_range = np.array([camera.near, min(camera.far, 1e30)])
        epsilon = self._auto_epsilon if settings.epsilon == "auto" else settings.epsilon
        cutoff = settings.cutoff if settings.kernel == "gaussian" else 0.0
        material = settings.material
        uniforms = {
            "rotation": rotation.T,  # column-major
            "translation": rotation @ self._sphere[0] + translation,
            "focal": (camera.fx, camera.fy),
            "principal": (camera.cx, camera.cy),
            "largest_point": largest_point(),
            "image_size": (camera.width, camera.height),
            "depth_range": depth_range,
            "depth_scale": depth_scale,
            "scaled_range": depth_range * depth_scale,
            "scaled_epsilon": min(epsilon * depth_scale, 1.0),
            "prefilter_radius": settings.prefilter_radius,
            "inverse_radius2": settings.prefilter_radius**-2,
            "exponent": -0.5 * cutoff**2 * math.log2(math.e),
            "material": (material.ambient, material.diffuse, material.specular, material.shininess),
            "light_place": [_place(light, camera) for light in settings.lights],
            "light_color": [light.color for light in settings.lights],
        }
        return depth_scale, uniforms


def vertices(splats: splatcl.Splats, origin: NDArray[Any]) -> NDArray[np.float32]:
    """Return (N, 12) float32: center minus `origin` (survey coordinates lose nothing), tangents, color, interleaved."""
    columns = (splats.center - origin, splats.tangent_u, splats.tangent_v, splats.color)
    return np.concatenate([column.astype(np.float32) for column in columns], axis=1)


def morton_order(points: NDArray[Any]) -> NDArray[np.intp]:
    """Return (N,) indices along a Z-order curve of 1024 cells a side."""
    low, extent = points.min(axis=0, initial=np.inf), np.ptp(points, axis=0).max() if len(points) else 1.0
    cells = (1023 * (points - low) / (extent or 1.0)).astype(np.uint32)
    for shift, mask in ((16, 0x030000FF), (8, 0x0300F00F), (4, 0x030C30C3), (2, 0x09249249)):
        cells = (cells | cells << shift) & mask  # spreads the bits to every third place
    return np.argsort(cells[:, 0] | cells[:, 1] << 1 | cells[:, 2] << 2, kind="stable")


def refuse_unsupported(camera: splatcl.Camera, settings: splatcl.RenderSettings) -> None:
    """Raise an error for a setting or projection that these shaders do not support."""
    if camera.projection != "perspective":
        raise CameraError(f"the OpenGL backend has perspective cameras only, not {camera.projection}")
    for name, supported in (
        ("along", ("z",)),
        ("epsilon_test", ("inclusive",)),
        ("filter_depth", ("center",)),
        ("prefilter_center", ("projected",)),
        ("kernel", ("gaussian", "constant")),
        ("precision", ("single",)),
        ("facing", ("keep", "flip", "cull")),
        ("prefilter", ("min", "none")),
        ("shader", ("phong", "albedo", "normal")),
    ):
        if getattr(settings, name) not in supported:
            choices = " and ".join(supported)
            raise SettingsError(f"the OpenGL backend has no {name} {getattr(settings, name)!r}, only {choices}")
    if any(light.kind == "spot" or light.shadow != "none" for light in settings.lights):
        raise SettingsError("the OpenGL backend has no lights with a cone or with shadows")


def _place(light: splatcl.Light, camera: splatcl.Camera) -> tuple[float, ...]:
    """Return the light's eye-space position and 1, or its direction and 0."""
    if light.kind == "headlight":
        return 0.0, 0.0, 0.0, 1.0
    rotated = camera.eye_from_world[:3, :3] @ light.vector
    if light.kind == "directional":
        return *rotated, 0.0
    return *(rotated + camera.eye_from_world[:3, 3]), 1.0


def _set(shaders: moderngl.Program, uniforms: dict[str, Any]) -> None:
    """Set the shaders' uniforms."""
    for unit, name in enumerate(("depth", "color_sum", "normal_sum")):
        if name in shaders:
            shaders[name].value = unit
    for name, value in uniforms.items():
        if name in shaders:
            shaders[name].write(np.asarray(value, np.float32).tobytes())


def _pixels(texture: moderngl.Texture) -> NDArray[np.float32]:
    """Return a texture as an (H, W, components) array."""
    width, height = texture.size
    return np.frombuffer(texture.read(), np.float32).reshape(height, width, texture.components)
