"""The groups of the help, in their order. The settings fill several panels, one for each subject."""

from __future__ import annotations

from typing import Any

from cyclopts import Group

SUBJECTS = {
    "Method": ("method", "footprint", "circular", "normals", "shading"),
    "Visibility": ("epsilon", "along", "epsilon-test", "facing"),
    "Weights": (
        *("prefilter", "prefilter-radius", "prefilter-center", "filter-depth", "sprite"),
        *("cutoff", "kernel", "kernel-table", "kernel-lookup", "table-addressing", "table-over"),
    ),
    "Color and lights": ("shader", "user-shader", "light", "material", "npr", "time"),
    "Sampling and precision": ("supersampling", "precision", "target", "half-inputs"),
}
"""Options of the settings by the title of their panel, without the part after a dot."""


def print_subjects(console: Any, options: Any, panel: Any) -> None:
    """Print the panel of the settings as one panel for each subject, with each help text as one paragraph."""
    from cyclopts.help.formatters import DefaultFormatter
    from rich.text import Text

    for title, names in SUBJECTS.items():
        entries = [
            entry.copy(description=Text(" ".join(str(entry.description.primary_renderable).split())))
            for name in names
            for entry in panel.entries
            if entry.names[0].removeprefix("--").split(".")[0] == name
        ]
        DefaultFormatter()(console, options, panel.copy(title=title, entries=entries))


FILES = Group("Input and output", sort_key=1)
OWN = Group("Options", sort_key=2)
"""Options of one command alone."""
CAMERA = Group("Camera", sort_key=3)
SETTINGS = Group("Settings", sort_key=4, help_formatter=print_subjects)
EVIDENCE = Group("Evidence", sort_key=5)
DEVICE = Group("Device", sort_key=6)
