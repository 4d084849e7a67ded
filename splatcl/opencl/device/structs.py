"""Structs shared with the device: a NumPy dtype each, and the C declaration made from it."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np

from splatcl.scene.settings import Precision

REAL_CODES: dict[Precision, str] = {"single": "f4", "double": "f8"}
"""NumPy code of each precision's real."""
C_NAMES = {"f4": "float", "f8": "double", "i4": "int", "u4": "uint", "i2": "short"}
"""C type of each NumPy code."""


def _reals(real: str, *names: str) -> list[tuple[str, str]]:
    return [(name, real) for name in names]


def _pairs(real: str, *names: str) -> list[tuple[str, str]]:
    return _reals(real, *(f"{name}_{part}" for name in names for part in ("hi", "lo")))


_CLIPS = [f"clip{line}_{term}" for line in (0, 1) for term in "xy1"]


def _fields(real: str) -> dict[str, list[tuple[str, str]]]:
    """Return the fields of every struct, (name, NumPy code); `real` is "f4" or "f8"."""
    rows = [f"r{row}{column}" for row in range(3) for column in range(3)]
    return {
        # The camera: eye_from_world for origin-relative world coordinates and the intrinsics, in twice the precision;
        # the window of the image, pixels.
        "View": _pairs(real, *rows, "t0", "t1", "t2", "fx", "fy", "cx", "cy")
        + _reals(real, "near", "far", "prefilter_radius", "reach", "low_pass", "low_pass_reach")
        + [
            (name, "i4")
            for name in ("first_column", "first_row", "width", "height", "facing", "prefilter", "prefilter_center")
        ],
        # 48 bytes: center, tangents and color of a splat, world space relative to the origin, for the projection.
        "Splat": _reals(real, "x", "y", "z", "ux", "uy", "uz", "vx", "vy", "vz", "red", "green", "blue"),
        # Optional data of a splat, world space: clip lines, normal field, specular, shininess.
        "SplatExtra": _reals(real, *_CLIPS, *(f"d{axis}_{k}" for axis in "uv" for k in "xyz"), "specular", "shininess"),
        # The same of an entry of the tile lists, eye space and raster, and its ellipse (kernels/splat/extra.h).
        "ProjectedExtra": _reals(real, "x", "y", "a", "b", "c", "ewa_a", "ewa_b", "ewa_c", "factor", *_CLIPS)
        + _reals(real, *(f"d{axis}_{k}" for axis in "uv" for k in "xyz"), "specular", "shininess"),
        # 16 bytes: first and last quarter tile that a splat may touch, column and row in 16 bits each; a depth that no
        # fragment is nearer than (kernels/passes/bin.cl, kernels/passes/occlusion.h).
        "TouchedQuarters": [(name, "i4") for name in ("id", "first", "last", "near_z")],
        # 64 bytes: the coefficients that intersect a ray with the splat's plane (kernels/splat/disc.h), and the pixels
        # of its disc; two vectors of eight reals, the pixels in the last two (kernels/arithmetic/transpose.h).
        "ProjectedSplat": _reals(real, "pixel_x", "pixel_y", "offset_x", "offset_y", "u_x", "u_y", "v_x", "v_y")
        + _reals(real, "g_x", "g_y", "z", "u_1", "v_1", "center_z")
        + [(name, "i2") for name in ("x_min", "y_min", "x_max", "y_max")]
        + ([("pad", real)] if real == "f8" else []),
        # 32 bytes: the attributes that the attribute pass sums, and the center of the pre-filter.
        "SplatAttributes": _reals(real, "red", "green", "blue", "normal_x", "normal_y", "normal_z")
        + _reals(real, "prefilter_x", "prefilter_y"),
        # A splat for margins and envelopes, in double precision (kernels/evidence/nearby.cl).
        "NearbySplat": _reals(real, "u_x", "u_y", "u_1", "v_x", "v_y", "v_1", "g_x", "g_y", "g_1", "h")
        + _reals(real, "center_x", "center_y", "den", "steep", "usable", "center_z", "near_z")
        + _reals(real, "filter_x", "filter_y", "filter_error", "filter_margin")
        + _reals(real, "x_first", "y_first", "x_last", "y_last"),
        # One splat at the probed pixel, and the pixel's sums after it (kernels/evidence/probe.cl).
        "ProbedSplat": _reals(real, "u", "v", "r3", "r2", "z", "weight", "weight_sum", "red", "green", "blue")
        + _reals(real, "normal_x", "normal_y", "normal_z")
        + [(name, "u4") for name in ("id", "count", "state")],
        # A light, eye space (kernels/shading/light.h): its position or the direction toward it, a spot's cone, the
        # index of its shadow map or -1.
        "PhongLight": [
            *_reals(real, "x", "y", "z", "is_point", "red", "green", "blue"),
            *_reals(real, "back_x", "back_y", "back_z", "cos_outer", "cone"),
            ("map", "i4"),
        ],
        # A shadow map: transform from eye space to the light's space, and the map's raster (kernels/shading/shadow.h);
        # `first` is the index of the map's first real.
        "ShadowMap": _reals(real, *rows, "t0", "t1", "t2", "focal", "middle", "near", "bias")
        + [(name, "i4") for name in ("perspective", "filtered", "size", "first")],
        "Shading": [*_reals(real, "ambient", "diffuse", "specular", "shininess"), ("num_lights", "i4")],
        "Npr": [*_reals(real, "contour", "silhouette", "red", "green", "blue"), ("num_tones", "i4")],
    }


@cache
def structs(real: str) -> tuple[Mapping[str, np.dtype[Any]], str]:
    """Return the dtypes by name, padded as C pads, and their C declarations.

    The declarations do not compile if the device's layout differs. Fields go from large to small, so only a struct's
    end is padded, and its size determines every offset. `pyopencl.tools.match_dtype_to_c_struct` would instead build a
    program for each struct, which slows every start.
    """
    dtypes = {name: np.dtype(fields, align=True) for name, fields in _fields(real).items()}
    return dtypes, "\n".join(_declaration(name, dtype) for name, dtype in dtypes.items())


def _declaration(name: str, dtype: np.dtype[Any]) -> str:
    fields = " ".join(f"{C_NAMES[dtype[field].str[1:]]} {field};" for field in dtype.names or ())
    size = dtype.itemsize
    return f"typedef struct {{ {fields} }} {name};\ntypedef char {name}_size[sizeof({name}) == {size} ? 1 : -1];"
