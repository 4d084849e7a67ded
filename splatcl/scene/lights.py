"""Lights and the Phong material of the shading pass."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from splatcl.errors import SettingsError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

Vector = tuple[float, float, float]
MAX_RADIANCE = 1e9
"""Of an environment's image."""


@dataclass(frozen=True)
class Light:
    """A white or coloured light (docs/guide/lights.md).

    Parameters
    ----------
    kind : {"headlight", "directional", "point", "spot"}
        At the eye; from a direction; at a position; at a position, within a cone. No light falls off with distance.
    vector : (3,) float
        World space: the direction *toward* a directional light, or the position of a point or spot light. Unused for
        a headlight.
    color : (3,) float
        Linear RGB intensity.
    direction : (3,) float
        World space: where a spot light shines. Unused for the others.
    inner, outer : float
        Degrees from a spot light's direction, 0 <= inner <= outer, 0.1 <= outer <= 89: its full light reaches to
        `inner`, none is beyond `outer`, and between them it is linear in the angle's cosine.
    shadow : {"none", "nearest", "pcf"}
        Whether the splats cast shadows in this light, and how its shadow map is read: the nearest texel, or
        percentage closer filtering, the bilinear mean of four texels' answers. For all but headlights.
    bias : float or "auto"
        Scene units by which a surface may lie behind the shadow map and still be lit; "auto" is twice the depth
        tolerance epsilon and two texels' width.
    map_size : int
        Texels of the shadow map each way, 16 to 8192.
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
        """Whether it shines from a position of its own."""
        return self.kind in ("point", "spot")


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


def environment_lights(image: ArrayLike, rows: int = 16, up: Literal["y", "z"] = "y") -> tuple[Light, ...]:
    """Turn an image of the surroundings into directional lights, for ``shader="lightmap"`` (docs/guide/lights.md).

    Surroundings of radiance 1 everywhere light a surface as one light of colour 1 straight above it does.

    Parameters
    ----------
    image : (H, W, 3) float array
        Linear RGB radiance, equirectangular as OpenEXR's: rows from up to down, the middle column toward +z, the
        columns right of it toward -x. H is a multiple of `rows` and W of 2 rows, or the image is smaller than that.
    rows : int
        Rows of lights, twice as many columns: the image is averaged over them.
    up : {"y", "z"}
        World axis that points up. For "z", the middle column is toward -y.

    Returns
    -------
    tuple of Light
        At most 2 rows^2, none for black cells.

    Raises
    ------
    SettingsError
        The image is not (H, W, 3), holds numbers that are negative or not finite, or does not fit `rows`.
    """
    import numpy as np  # not for `splatcl --help`

    pixels = np.asarray(image, np.float64)
    if pixels.ndim != 3 or pixels.shape[2] != 3 or not pixels.size:
        raise SettingsError(f"an environment image is (H, W, 3), not {pixels.shape}")
    if not ((pixels >= 0) & (pixels <= MAX_RADIANCE)).all():
        raise SettingsError(f"an environment image holds numbers from 0 to {MAX_RADIANCE:g} alone")
    height, width = min(rows, pixels.shape[0]), min(2 * rows, pixels.shape[1])
    if rows < 1 or pixels.shape[0] % height or pixels.shape[1] % width or up not in ("y", "z"):
        raise SettingsError(
            f"an environment image of {pixels.shape[1]}x{pixels.shape[0]} cannot be averaged to {2 * rows}x{rows} "
            f"lights with up={up!r}: choose rows that divide its size, and up='y' or 'z'"
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
