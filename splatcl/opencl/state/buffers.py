"""The records between the passes, on the device: each one's shapes, once (oracle/buffers.py has their twins)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

Channels = Mapping[str, tuple[Any, int]]
"""By a splat attribute's name: a (H, W, 3) image, and which of its channels holds the blended attribute."""
NO_CHANNELS: Channels = MappingProxyType({})


@dataclass(frozen=True)
class TileLists:
    """Splats that may touch each tile of the band [first_tile, last_tile), a run for each tile, in splat order.

    The band's entries are `ids[start:start + begin[-1]]`; tile t's among them are from begin[t - first_tile].
    Where there are layers, `clues` says which each is in (kernels/clue.h).
    """

    ids: Any
    keys: Any
    start: int
    begin: NDArray[np.int32]
    begin_buffer: Any
    first_tile: int
    last_tile: int


@dataclass(frozen=True)
class ProjectedSplats:
    """A record for each entry of the tile lists, with the pixels of its disc and those of its pre-filter as well.

    `near_z` is a depth that no fragment is nearer than, `disc_near_z` the same for the disc alone and only for this
    layer; NaN where there are no pixels, and where the entry was not projected. `extra` is what methods other than
    [BHZK05]'s need, by the build `options` (kernels/extra.h).
    """

    records: Any
    attributes: Any
    boxes: Any
    disc_near_z: Any
    near_z: Any
    extra: Any
    options: Mapping[str, Any]


@dataclass(frozen=True)
class DepthBuffer:
    """Visibility depth (eye z, +inf where none) and the splat that set it (0xFFFFFFFF none), (H, W)."""

    depth: Any
    particleid: Any


@dataclass(frozen=True)
class GBuffer:
    """Sums over accepted fragments: weight (H, W), color and normal (H, W, 3), depth (H, W), count (H, W)."""

    weight_sum: Any
    color_sum: Any
    normal_sum: Any
    depth_sum: Any
    count: Any


@dataclass(frozen=True)
class Band:
    """A band of tiles, projected and visible: what the attribute pass takes."""

    view: Any  # View, the camera
    lists: TileLists
    projected: ProjectedSplats
    depth: DepthBuffer
    epsilon: float  # depth tolerance, scene units


@dataclass(frozen=True)
class Surface:
    """AOVs to shade: P, N and albedo (H, W, 3), and a weight (H, W) above 0 where there is a surface."""

    position: Any
    normal: Any
    albedo: Any
    weight: Any
    channels: Channels = field(default_factory=dict)


@dataclass(frozen=True)
class Shadows:
    """The shadow maps of a frame: their structs and all their depths on the device, and each light's bias."""

    maps: Any
    depths: Any
    bias: tuple[float | None, ...]
