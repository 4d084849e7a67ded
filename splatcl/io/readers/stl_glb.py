"""STL and GLB meshes, read through trimesh."""

from __future__ import annotations

import io
import json
import logging
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splatcl.errors import FileError
from splatcl.io.readers.model import Model, foreign_errors, require

HARMLESS = ("KHR_materials_", "KHR_texture_", "EXT_texture_", "KHR_lights_")
"""Prefixes of the glTF extensions that do not move the surface."""


def read_stl(path: Path) -> Model:
    """Read an ASCII or binary STL file.

    Raises
    ------
    FileError
        trimesh is missing, or the file is damaged or truncated.
    """
    data = path.read_bytes()
    announced = int.from_bytes(data[80:84], "little")
    binary = len(data) == 84 + 50 * announced and len(data) >= 84
    if not binary and b"facet" not in data.lower():
        raise FileError(
            f"{path}: byte 80 announces {announced} triangles, which take {84 + 50 * announced} bytes, but the "
            f"file has {len(data)}; it is truncated, or no STL file"
        )
    notes: list[str] = []
    model = _model(path, f"STL ({'binary' if binary else 'ascii'})", _scene(path, data, "stl", notes), notes)
    num = 0 if model.faces is None else len(model.faces)
    if not binary and data.lower().count(b"vertex") != 3 * num:
        raise FileError(
            f"{path}: has {data.lower().count(b'vertex')} vertex lines but {num} whole triangles; the file is truncated"
        )
    return model


def read_glb(path: Path) -> Model:
    """Read all meshes and points of a GLB scene, each transformed by its nodes; colors are linear.

    Raises
    ------
    FileError
        trimesh is missing, the file is damaged, or it needs an extension that moves the surface.
    """
    data = path.read_bytes()
    notes: list[str] = []
    with foreign_errors(path, "GLB file", notes):
        header = json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])
        needed = [name for name in header.get("extensionsRequired", []) if not str(name).startswith(HARMLESS)]
        images = len(header.get("images", []))
    if needed:
        raise FileError(f"{path}: needs the glTF extension {needed[0]}, which splatcl cannot read; export without it")
    if images:
        notes.append(f"ignored {images} texture images")
    return _model(path, "GLB", _scene(path, data, "glb", notes), notes)


def _scene(path: Path, data: bytes, kind: str, notes: list[str]) -> Any:
    trimesh = require(path, "trimesh", "mesh")
    logging.getLogger("trimesh").addHandler(logging.NullHandler())  # it logs tracebacks of errors that it mends
    with foreign_errors(path, f"{kind.upper()} file", notes):
        return trimesh.load_scene(io.BytesIO(data), file_type=kind, process=False)


def _model(path: Path, kind: str, scene: Any, notes: list[str]) -> Model:
    """Join the geometry of a scene in world space."""
    parts, faces, start, skipped = [], [], 0, 0
    with foreign_errors(path, kind, notes):
        for node in sorted(scene.graph.nodes_geometry):
            matrix, name = scene.graph[node]
            geometry = scene.geometry[name]
            vertices = np.asarray(geometry.vertices, np.float64)
            if vertices.ndim != 2 or vertices.shape[1] != 3 or type(geometry).__name__ not in ("Trimesh", "PointCloud"):
                skipped += 1
                continue
            triangles = np.asarray(getattr(geometry, "faces", np.empty((0, 3))), np.int64).reshape(-1, 3)
            if np.linalg.det(matrix[:3, :3]) < 0:  # a mirroring transform reverses the winding
                triangles = triangles[:, ::-1]
            if len(triangles) and (triangles.min() < 0 or triangles.max() >= len(vertices)):
                raise FileError(
                    f"{path}: mesh {name} has a face index beyond its {len(vertices)} vertices; the file is damaged"
                )
            with np.errstate(invalid="ignore", over="ignore"):
                parts.append((vertices @ matrix[:3, :3].T + matrix[:3, 3], _color(geometry)))
            faces.append(triangles + start)
            start += len(vertices)
    if skipped:
        notes.append(f"ignored {skipped} lines or curves")
    if not parts:
        raise FileError(f"{path}: has no points")
    colors = [color for _, color in parts]
    color = None
    if any(c is not None for c in colors):
        white = np.ones(3, np.float32)
        color = np.concatenate([np.tile(white, (len(p), 1)) if c is None else c for p, c in parts])
    triangles = np.concatenate(faces)
    return Model(
        path,
        kind,
        np.concatenate([vertices for vertices, _ in parts]),
        color=color,
        faces=triangles if len(triangles) else None,
        notes=tuple(notes),
    )


def _color(geometry: Any) -> NDArray[np.float32] | None:
    """Return (V, 3) linear RGB of the vertices, else the material's color, else None."""
    visual = geometry.visual
    factor = getattr(getattr(visual, "material", None), "baseColorFactor", None)
    color = None
    if factor is not None:
        color = np.tile(np.asarray(factor[:3], np.float32) / np.float32(255), (len(geometry.vertices), 1))
    if getattr(visual, "kind", None) == "vertex":
        stored = np.asarray(visual.vertex_colors, np.float32)
        if stored.shape == (len(geometry.vertices), 4):  # points without colors have another shape
            color = stored[:, :3] / np.float32(255)
    return color
