"""``splatcl features``: a mesh in, splats with clip lines out."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from splatcl.errors import FileError, InvalidSplatsError, SettingsError
from splatcl.scene.splats import OnInvalid
from splatcl.util.progress import stage


def features(
    mesh: Path,
    /,
    *,
    output: Annotated[Path, Parameter(alias="-o")],
    angle: float = 30.0,
    on_invalid: OnInvalid = "error",
) -> None:
    """Make splats of a mesh that end at its sharp edges.

    Parameters
    ----------
    mesh : path
        OBJ, OFF, PLY, STL or GLB with triangles.
    output : path
        The splats, .ply or .npz.
    angle : float
        Degrees between the normals of two faces above which their edge is sharp.
    on_invalid : str
        What to do with triangles that have non-finite numbers.
    """
    from splatcl.features import mesh_features
    from splatcl.io.read import load_model, mesh_splats
    from splatcl.io.write import write

    if output.suffix.lower() not in (".ply", ".npz"):
        raise SettingsError(f"--output {output} must end in .ply or .npz")
    with stage("Finding features"):
        model = load_model(mesh)
        if model.faces is None or not len(model.faces):
            raise FileError(f"{mesh}: has no triangles; sharp edges are those of a mesh")
        try:
            splats = mesh_splats(model, on_invalid, partial(mesh_features, angle=angle))
        except InvalidSplatsError as error:
            raise InvalidSplatsError(f"{mesh}: {error}") from None
    for note in splats.notes:
        print(f"note: {note}")
    write(splats, output)
    print(f"wrote {output} ({len(splats)} splats)")
