"""All experiments by name, in the order of the papers."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from splatcl.errors import SettingsError
from splatcl.paper.antialiasing import checkerboards, screen_filter
from splatcl.paper.comparison import comparison
from splatcl.paper.experiment import Result, Run
from splatcl.paper.filters import kernels
from splatcl.paper.overdraw import overdraw
from splatcl.paper.perspective import holes
from splatcl.paper.shaders import shaders
from splatcl.paper.sharp import sharp_features
from splatcl.paper.targets import half_inputs, targets

Experiment = Callable[[Run], Result]
EXPERIMENTS: dict[str, Experiment] = {
    experiment.__name__: experiment
    for experiment in (
        targets,
        checkerboards,
        kernels,
        shaders,
        overdraw,
        half_inputs,
        holes,
        sharp_features,
        screen_filter,
        comparison,
    )
}


def chosen(names: Sequence[str]) -> list[Experiment]:
    """Return the experiments of these names, or all for no names; `SettingsError` lists the choices."""
    for name in names:
        if name not in EXPERIMENTS:
            raise SettingsError(f"no experiment {name!r}; there are {', '.join(EXPERIMENTS)}")
    return [EXPERIMENTS[name] for name in names or EXPERIMENTS]
