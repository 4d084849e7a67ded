"""``splatcl features``: a mesh in, splats with clip lines out."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from splatcl.cli.options.groups import FILES
from splatcl.cli.options.inputs import OnInvalidOption
from splatcl.cli.options.outputs import SplatsOption, save_splats
from splatcl.errors import FileError, InvalidSplatsError
from splatcl.io.write import check_output
from splatcl.util.progress import stage


def features(
    mesh: Annotated[Path, Parameter(group=FILES)],
    /,
    *,
    output: SplatsOption,
    angle: float = 30.0,
    on_invalid: OnInvalidOption = "error",
) -> None:
    """Make splats of a mesh that end at its sharp edges.

    Parameters
    ----------
    mesh : path
        Mesh of triangles: OBJ, OFF, PLY, STL or GLB.
    angle : float
        Angle between the normals of two faces above which their edge is sharp, degrees.
    """
    from splatcl.features import mesh_features
    from splatcl.io.read import load_model, mesh_splats

    check_output(output)
    with stage("Finding features"):
        model = load_model(mesh)
        if model.faces is None or not len(model.faces):
            raise FileError(f"{mesh}: has no triangles; give a mesh")
        try:
            splats = mesh_splats(model, on_invalid, partial(mesh_features, angle=angle))
        except InvalidSplatsError as error:
            raise InvalidSplatsError(f"{mesh}: {error}") from None
    save_splats(splats, output)
