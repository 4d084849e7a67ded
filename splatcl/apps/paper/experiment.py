"""What an experiment is given and what it returns."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from numpy.typing import NDArray

from splatcl.frame import Frame
from splatcl.renderer import Renderer
from splatcl.scene.camera import Camera
from splatcl.scene.settings import RenderSettings
from splatcl.scene.splats import Splats

LEAST = 16
"""Pixels, splats or samples that even the smallest run has."""


class Figure(NamedTuple):
    """A number that was measured: of what, which measure, in which unit."""

    of: str
    measure: str
    value: float
    unit: str = ""

    def __str__(self) -> str:
        whole = float(self.value).is_integer() or abs(self.value) >= 1e4
        digits = f"{self.value:,.0f}" if whole and abs(self.value) < 1e15 else f"{self.value:.3g}"
        return digits + (self.unit if self.unit[:1] in "%/" else f" {self.unit}")


class Claim(NamedTuple):
    """What a paper says, in our words, and what is found here."""

    says: str
    here: str
    holds: bool


@dataclass(frozen=True)
class Result:
    """What an experiment found.

    Parameters
    ----------
    name : str
        That of its function.
    title : str
        Which figure, table or section it reruns.
    figures : tuple of Figure
    claims : tuple of Claim
    images : mapping of str to Frame or (H, W), (H, W, 3) or (H, W, 4) float array
        Arrays are linear and become PNG; a Frame becomes PNG and OpenEXR, with every AOV.
    notes : tuple of str
        Sentences: what names mean, and what could not be measured.
    """

    name: str
    title: str
    figures: tuple[Figure, ...]
    claims: tuple[Claim, ...]
    images: Mapping[str, Frame | NDArray[Any]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Run:
    """Where an experiment renders and how large.

    Parameters
    ----------
    renderer : Renderer
    scale : float
        Lengths of images in units of those of the full run; numbers of splats go with its square.
    """

    renderer: Renderer
    scale: float = 1.0

    def pixels(self, length: int) -> int:
        """Return the length of an image's side that is `length` pixels in the full run."""
        return max(LEAST, round(self.scale * length))

    def number(self, count: int) -> int:
        """Return how many splats stand for `count` of the full run."""
        return max(LEAST, round(self.scale**2 * count))

    def render(self, splats: Splats, camera: Camera, **settings: Any) -> Frame:
        """Render with `RenderSettings` of these values."""
        return self.renderer.render(splats, camera, RenderSettings(**settings))
