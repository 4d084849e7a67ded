"""Lights and the Phong material of the shading pass."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Light:
    """A white or coloured light.

    Parameters
    ----------
    kind : {"headlight", "directional", "point"}
        At the eye; from a direction; at a position. No light falls off with distance.
    vector : (3,) float
        World space: the direction *toward* a directional light, or a point light's position. Unused for a
        headlight.
    color : (3,) float
        Linear RGB intensity.
    """

    kind: Literal["headlight", "directional", "point"] = "headlight"
    vector: Vector = (0.0, 0.0, 0.0)
    color: Vector = (1.0, 1.0, 1.0)


@dataclass(frozen=True)
class Material:
    """Phong coefficients: color = albedo (ambient + diffuse sum N.L) + specular sum (R.V)^shininess."""

    ambient: float = 0.1
    diffuse: float = 0.8
    specular: float = 0.1
    shininess: float = 32.0


@dataclass(frozen=True)
class Npr:
    """What the ``npr`` shader draws: flat tones between dark lines.

    Parameters
    ----------
    tones : tuple of float
        The 1D transfer table: the diffuse light, 0 ... 1, chooses one of them, each as wide as the others.
    contour : float or "auto"
        Depth jump within the 3x3 neighbourhood from which a pixel belongs to a contour, scene units along eye z;
        "auto" is four times the depth tolerance epsilon.
    silhouette : float
        Cosine between normal and view below which a pixel belongs to the silhouette.
    line : (3,) float
        Linear RGB of the lines.
    """

    tones: tuple[float, ...] = (0.15, 0.4, 0.7, 1.0)
    contour: float | Literal["auto"] = "auto"
    silhouette: float = 0.2
    line: Vector = (0.0, 0.0, 0.0)
