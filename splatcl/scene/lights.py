"""Lights and the Phong material of the shading pass."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from splatcl.errors import SettingsError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

Vector = tuple[float, float, float]
MAX_RADIANCE = 1e9
"""Largest radiance in an image of the surroundings."""


@dataclass(frozen=True)
class Light:
    """A light source (docs/guide/lights.md). Its intensity does not fall off with distance.

    Parameters
    ----------
    kind : {"headlight", "directional", "point", "spot"}
        headlight: at the eye; directional: from a direction; point: at a position; spot: at a position, within a cone.
    vector : (3,) float
        World space: direction *toward* a directional light, or position of a point or spot light. A headlight
        ignores it.
    color : (3,) float
        Linear RGB intensity.
    direction : (3,) float
        World space: direction in which a spot light shines. The other kinds ignore it.
    inner, outer : float
        Angles from the direction of a spot light, degrees, 0 <= inner <= outer, 0.1 <= outer <= 89. The light is full
        up to `inner` and zero beyond `outer`. Between them it is linear in the cosine of the angle.
    shadow : {"none", "nearest", "pcf"}
        none: no shadows; nearest: read the nearest texel of the shadow map; pcf: percentage closer filtering, the
        bilinear mean of four texels' tests. Headlights have no shadows.
    bias : float or "auto"
        Distance by which a surface may lie behind the shadow map and still be lit, scene units; auto: twice the
        depth tolerance epsilon plus the width of two texels.
    map_size : int
        Width and height of the shadow map, texels, 16 to 8192.
    """

    kind: Literal["headlight", "directional", "point", "spot"] = "headlight"
    vector: Vector = (0.0, 0.0, 0.0)
    color: Vector = (1.0, 1.0, 1.0)
    direction: Vector = (0.0, 0.0, 0.0)
    inner: float = 20.0
    outer: float = 30.0
    shadow: Literal["none", "nearest", "pcf"] = "none"
    bias: float | Literal["auto"] = "auto"
    map_size: int = 1024

    @property
    def has_place(self) -> bool:
        """Whether the light has a position: a point or spot light."""
        return self.kind in ("point", "spot")


@dataclass(frozen=True)
class Material:
    """Phong coefficients: color = albedo (ambient + diffuse sum N.L) + specular sum (R.V)^shininess.

    Parameters
    ----------
    ambient : float
        Factor of the albedo that needs no light.
    diffuse : float
        Factor of the diffuse term, albedo sum N.L.
    specular : float
        Factor of the specular term, sum (R.V)^shininess.
    shininess : float
        Exponent of the specular term; larger makes highlights smaller.
    """

    ambient: float = 0.1
    diffuse: float = 0.8
    specular: float = 0.1
    shininess: float = 32.0


@dataclass(frozen=True)
class Npr:
    """Parameters of the shader ``npr``: flat tones between dark lines.

    Parameters
    ----------
    tones : tuple of float
        Transfer table: the diffuse light, 0 to 1, chooses one of these tones, at equal steps.
    contour : float or "auto"
        Depth jump within 3x3 pixels that makes a pixel part of a contour, scene units along the eye's z axis;
        auto: four times the depth tolerance epsilon.
    silhouette : float
        Cosine between normal and view below which a pixel is part of the silhouette.
    line : (3,) float
        Linear RGB of contours and silhouettes.
    """

    tones: tuple[float, ...] = (0.15, 0.4, 0.7, 1.0)
    contour: float | Literal["auto"] = "auto"
    silhouette: float = 0.2
    line: Vector = (0.0, 0.0, 0.0)


def environment_lights(image: ArrayLike, rows: int = 16, up: Literal["y", "z"] = "y") -> tuple[Light, ...]:
    """Turn an image of the surroundings into directional lights, for ``shader="lightmap"`` (docs/guide/lights.md).

    Surroundings of radiance 1 everywhere light a surface like one light of color 1 straight above it.

    Parameters
    ----------
    image : (H, W, 3) float array
        Linear RGB radiance, equirectangular as in OpenEXR: rows from up to down, the middle column toward +z, the
        columns right of it toward -x. H must be a multiple of `rows` and W of 2 `rows`, or the image smaller.
    rows : int
        Rows of lights; the columns are twice as many. Each light is the mean over its part of the image.
    up : {"y", "z"}
        World axis that points up. For "z", the middle column is toward -y.

    Returns
    -------
    tuple of Light
        At most 2 rows^2; black parts of the image have no light.

    Raises
    ------
    SettingsError
        The image is not (H, W, 3), has negative or non-finite numbers, or its size does not fit `rows`.
    """
    import numpy as np  # not for `splatcl --help`

    pixels = np.asarray(image, np.float64)
    if pixels.ndim != 3 or pixels.shape[2] != 3 or not pixels.size:
        raise SettingsError(f"an environment image must be (H, W, 3), not {pixels.shape}")
    if not ((pixels >= 0) & (pixels <= MAX_RADIANCE)).all():
        raise SettingsError(f"an environment image must hold numbers from 0 to {MAX_RADIANCE:g}")
    height, width = min(rows, pixels.shape[0]), min(2 * rows, pixels.shape[1])
    if rows < 1 or pixels.shape[0] % height or pixels.shape[1] % width or up not in ("y", "z"):
        raise SettingsError(
            f"an environment image of {pixels.shape[1]}x{pixels.shape[0]} cannot be averaged to {2 * rows}x{rows} "
            f"lights with up={up!r}; choose rows that divide its size, and up='y' or 'z'"
        )
    edges = np.cos(np.pi * np.arange(pixels.shape[0] + 1) / pixels.shape[0])
    solid_angle = (edges[:-1] - edges[1:]) * (2 * np.pi / pixels.shape[1])
    power = (pixels * (solid_angle / np.pi)[:, None, None]).reshape(height, -1, width, pixels.shape[1] // width, 3)
    power = power.sum(axis=(1, 3))
    polar = np.pi * (np.arange(height) + 0.5) / height
    longitude = np.pi * (1 - 2 * (np.arange(width) + 0.5) / width)
    lights = []
    for row, column in zip(*np.nonzero(power.any(axis=2)), strict=True):
        level = float(np.sin(polar[row]))
        right, above, front = (
            level * float(np.sin(longitude[column])),
            float(np.cos(polar[row])),
            level * float(np.cos(longitude[column])),
        )
        vector = (right, above, front) if up == "y" else (right, -front, above)
        red, green, blue = map(float, power[row, column])
        lights.append(Light("directional", vector, (red, green, blue)))
    return tuple(lights)
