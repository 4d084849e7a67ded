"""The input and the result of an experiment."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

from numpy.typing import NDArray

from splatcl.frame import Frame
from splatcl.renderer import Renderer
from splatcl.scene.camera import Camera
from splatcl.scene.settings import RenderSettings
from splatcl.scene.splats import Splats

Verdict = Literal["holds", "holds in part", "does not hold"]
LEAST = 16
"""Least number of pixels or splats, in even the smallest run."""


class Figure(NamedTuple):
    """A measured number: the object `of`, the measure, the value and its unit."""

    of: str
    measure: str
    value: float
    unit: str = ""

    def __str__(self) -> str:
        whole = float(self.value).is_integer() or abs(self.value) >= 1e4
        digits = f"{self.value:,.0f}" if whole and abs(self.value) < 1e15 else f"{self.value:.3g}"
        return digits + (self.unit if self.unit[:1] in "%/" else f" {self.unit}")


class Claim(NamedTuple):
    """A paper's statement in our words, the finding here, and the verdict on the statement."""

    says: str
    here: str
    verdict: Verdict


def verdict(whole: bool, part: bool = False) -> Verdict:
    """Return the verdict on a statement, given whether all of it holds and whether a part of it holds."""
    return "holds" if whole else "holds in part" if part else "does not hold"


@dataclass(frozen=True)
class Result:
    """The result of one experiment.

    Parameters
    ----------
    name : str
        Name of the experiment's function.
    title : str
        Figure, table or section that the experiment reruns.
    figures : tuple of Figure
    claims : tuple of Claim
    images : mapping of str to Frame or (H, W), (H, W, 3) or (H, W, 4) float array
        Arrays are linear and become PNG; a Frame becomes PNG and OpenEXR, with every AOV.
    notes : tuple of str
        Sentences that explain names, or say which measure is missing.
    """

    name: str
    title: str
    figures: tuple[Figure, ...]
    claims: tuple[Claim, ...]
    images: Mapping[str, Frame | NDArray[Any]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Run:
    """The renderer of an experiment and the size of its images.

    Parameters
    ----------
    renderer : Renderer
    scale : float
        Side of the images in units of the full run. Numbers of splats scale with its square.
    """

    renderer: Renderer
    scale: float = 1.0

    def pixels(self, length: int) -> int:
        """Return the length, in pixels, of an image side that has `length` pixels in the full run."""
        return max(LEAST, round(self.scale * length))

    def number(self, count: int) -> int:
        """Return the number of splats that replaces `count` splats of the full run."""
        return max(LEAST, round(self.scale**2 * count))

    def render(self, splats: Splats, camera: Camera, **settings: Any) -> Frame:
        """Render with `RenderSettings` of these values."""
        return self.renderer.render(splats, camera, RenderSettings(**settings))
