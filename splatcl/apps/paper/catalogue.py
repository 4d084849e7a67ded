"""All experiments by name, in the order of the papers."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from splatcl.apps.paper.experiment import Result, Run
from splatcl.apps.paper.experiments.antialiasing import checkerboards, screen_filter
from splatcl.apps.paper.experiments.comparison import comparison
from splatcl.apps.paper.experiments.filters import kernels
from splatcl.apps.paper.experiments.overdraw import overdraw
from splatcl.apps.paper.experiments.perspective import holes
from splatcl.apps.paper.experiments.shaders import shaders
from splatcl.apps.paper.experiments.sharp import sharp_features
from splatcl.apps.paper.experiments.targets import half_inputs, targets
from splatcl.errors import SettingsError

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
