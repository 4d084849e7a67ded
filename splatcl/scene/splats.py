"""Splats: oriented elliptical discs, the input of every pass."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import InitVar, dataclass, field, replace
from types import MappingProxyType
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from splatcl.errors import InvalidSplatsError

OnInvalid = Literal["error", "drop"]
DEFAULT_COLOR = (0.6, 0.6, 0.6)
"""Linear RGB of splats without a color."""

MIN_AREA = 1e-15
"""Smallest |t_u x t_v| of a usable splat, square scene units: a smaller one loses its normal in float32."""
MAX_AREA = 1e19
"""Largest |t_u x t_v| of a usable splat, square scene units: its square must stay finite in float32."""
MAX_MAGNITUDE = 1e15
"""Largest usable coordinate: its square must stay finite in float32."""
OPTIONAL = {"normal_du": (3,), "normal_dv": (3,), "clip": (2, 3)}
"""Optional arrays of splats by name, each with the shape of a row."""
PREFIX = "attribute."
"""Prefix of an attribute's name among the names of other arrays."""
BLOCK = 16384
"""Splats validated at a time: their temporaries fit into the CPU's cache."""


@dataclass(frozen=True, eq=False)
class Splats:
    """Oriented elliptical discs: a point of a disc is c + u t_u + v t_v with u^2 + v^2 <= 1.

    Parameters
    ----------
    center : (N, 3) float array
        Disc centers c, world space, scene units. float64 is kept, so surveys in UTM meters lose no digits.
    tangent_u, tangent_v : (N, 3) float array
        Tangent axes, world space; their lengths are the principal radii in scene units.
        The normal is normalize(t_u x t_v) ([BHZK05] eq. 1).
    color : (N, 3) float array, optional
        Linear RGB; `DEFAULT_COLOR` by default.
    normal_du, normal_dv : (N, 3) float array, optional
        Linear normal field, world space. The normal at (u, v) of the disc is normalize(n + u n_du + v n_dv)
        ([BSK04]); n is the disc's own normal. Give both arrays or neither.
    clip : (N, 2, 3) float array, optional
        Up to two clip lines as rows (a, b, c), disc coordinates ([ZRB04] section 5). The half plane
        a u + b v + c >= 0 of the disc and of its pre-filter is kept. A row of zeros cuts nothing.
    attributes : mapping of str to (N,) float array
        Named channels, blended like the color; each becomes the AOV ``attribute.NAME``. ``specular`` and
        ``shininess`` replace the material's values.
    oriented : bool
        False if the signs of the normals are arbitrary, as estimates from bare points are. The renderer then turns
        each normal toward the viewer.
    num_dropped : int
        Number of invalid splats dropped earlier (see `on_invalid`).
    notes : tuple of str
        One sentence for each estimate, conversion and omission on the way from the file.
    on_invalid : {"error", "drop"}
        Treatment of splats with a non-finite or huge coordinate, color or tangent, or with no area or a huge one.

    Raises
    ------
    InvalidSplatsError
        An array has a wrong shape or is not numeric, or splats are invalid under ``on_invalid="error"``. The message
        gives the number of invalid splats and the first index.
    """

    center: NDArray[Any]
    tangent_u: NDArray[Any]
    tangent_v: NDArray[Any]
    color: NDArray[Any] = field(default=None)  # type: ignore[arg-type]
    oriented: bool = True
    num_dropped: int = 0
    notes: tuple[str, ...] = ()
    on_invalid: InitVar[OnInvalid] = "error"
    normal_du: NDArray[Any] | None = None
    normal_dv: NDArray[Any] | None = None
    clip: NDArray[Any] | None = None
    attributes: Mapping[str, NDArray[Any]] = field(default_factory=dict)

    def __post_init__(self, on_invalid: OnInvalid) -> None:
        arrays = {name: _rows(name, getattr(self, name), 3) for name in ("center", "tangent_u", "tangent_v")}
        num = len(arrays["center"])
        color = np.full((num, 3), DEFAULT_COLOR, np.float32) if self.color is None else self.color
        arrays["color"] = _rows("color", color, 3)
        optional = self._checked_optional()
        for name, array in (arrays | optional).items():
            if len(array) != num:
                raise InvalidSplatsError(f"{name} has {len(array)} rows but center has {num}")
        reason = invalid_splats(**arrays)
        for array in optional.values():
            reason = np.where(reason == 0, _optional_reasons(array), reason)
        arrays |= optional
        if reason.any():
            problem = describe_reasons(reason, REASONS, "splat")
            if on_invalid == "error":
                raise InvalidSplatsError(f"{problem}; drop them with on_invalid='drop'")
            arrays = {name: array[reason == 0] for name, array in arrays.items()}
            object.__setattr__(self, "notes", (*self.notes, f"dropped {problem}"))
            object.__setattr__(self, "num_dropped", self.num_dropped + int(np.count_nonzero(reason)))
        for name, array in arrays.items():
            array.setflags(write=False)
            if name not in optional or name in OPTIONAL:
                object.__setattr__(self, name, array)
        named = {name: arrays[PREFIX + name] for name in self.attributes}
        object.__setattr__(self, "attributes", MappingProxyType(named))

    def _checked_optional(self) -> dict[str, NDArray[Any]]:
        """Check the names and row shapes of the optional arrays; return the arrays as floats."""
        if (self.normal_du is None) != (self.normal_dv is None):
            raise InvalidSplatsError("normal_du and normal_dv go together: give both or neither")
        for name in self.attributes:
            if not isinstance(name, str) or not re.fullmatch(r"[a-z_][a-z0-9_]{0,63}", name):
                raise InvalidSplatsError(
                    f"attribute {name!r} must be named with lower-case letters, digits and _, at most 64"
                )
        return {name: _rows(name, value, *OPTIONAL.get(name, ())) for name, value in self.optional.items()}

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "attributes": dict(self.attributes)}

    def __len__(self) -> int:
        return len(self.center)

    @property
    def optional(self) -> dict[str, NDArray[Any]]:
        """The optional arrays of these splats by name; an attribute's name is ``attribute.NAME``."""
        present = {name: getattr(self, name) for name in OPTIONAL if getattr(self, name) is not None}
        return present | {PREFIX + name: values for name, values in self.attributes.items()}

    @property
    def normal(self) -> NDArray[Any]:
        """(N, 3) float64 unit normals normalize(t_u x t_v), world space."""
        normal = np.cross(self.tangent_u.astype(np.float64), self.tangent_v.astype(np.float64))
        return normal / np.linalg.norm(normal, axis=1, keepdims=True)

    @property
    def radius(self) -> NDArray[np.float64]:
        """(N,) float64 larger principal radii max(|t_u|, |t_v|), scene units."""
        norms = [np.linalg.norm(t.astype(np.float64), axis=1) for t in (self.tangent_u, self.tangent_v)]
        return np.maximum(*norms)

    @property
    def bounds(self) -> NDArray[np.float64]:
        """(2, 3) float64 least and greatest corner of the discs' bounding box, world space; zeros without splats."""
        if not len(self):
            return np.zeros((2, 3))
        half = np.hypot(self.tangent_u.astype(np.float64), self.tangent_v.astype(np.float64))
        center = self.center.astype(np.float64)
        return np.stack([(center - half).min(axis=0), (center + half).max(axis=0)])

    @property
    def bounding_sphere(self) -> tuple[NDArray[np.float64], float]:
        """(3,) float64 center of `bounds`, world space, and radius of the sphere around it that holds every disc."""
        middle = self.bounds.mean(axis=0)
        distance = np.linalg.norm(self.center - middle, axis=1) + self.radius
        return middle, float(distance.max(initial=0.0))

    def without_outliers(self) -> Splats:
        """Return the splats without outliers, for framing a raw scan.

        An outlier lies more than twice as far from the median center as the 95 % quantile.
        """
        if not len(self):
            return self
        distance = np.linalg.norm(self.center - np.median(self.center, axis=0), axis=1)
        near = distance <= 2 * np.quantile(distance, 0.95)
        return self if near.all() else self.take(near)

    def circular(self) -> Splats:
        """Replace each ellipse by the circle of its larger radius; t_u keeps its direction ([BK03])."""
        u = self.tangent_u.astype(np.float64)
        length = np.linalg.norm(u, axis=1, keepdims=True)
        turned = np.cross(self.normal, u)
        grow = self.radius[:, None] / length
        return replace(self, tangent_u=u * grow, tangent_v=turned * grow)

    def scaled(self, factor: float) -> Splats:
        """Return discs of `factor` times the radii about the same centers; clip lines and normal fields stay in place.

        It turns the standard deviations of [ZRB04]'s Gaussians into discs that end at the cutoff F_g = `factor`.
        """
        given: dict[str, Any] = {"tangent_u": self.tangent_u * factor, "tangent_v": self.tangent_v * factor}
        for name in ("normal_du", "normal_dv"):
            if getattr(self, name) is not None:
                given[name] = getattr(self, name) * factor
        if self.clip is not None:
            given["clip"] = self.clip * np.array([factor, factor, 1.0])
        return replace(self, **given, on_invalid="error")

    def half_precision(self) -> Splats:
        """Round centers and normals to 16-bit floats ([BHZK05] section 6).

        Centers are rounded relative to the middle of their bounding box, in units of its largest half side. Tangents
        are projected onto the plane of the rounded normal and keep their lengths.
        """
        if not len(self):
            return self
        center = self.center.astype(np.float64)
        middle = (center.min(axis=0) + center.max(axis=0)) / 2
        size = float(np.abs(center - middle).max()) or 1.0
        rounded = middle + _half((center - middle) / size) * size
        normal = _half(self.normal)
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        tangents = {}
        for name in ("tangent_u", "tangent_v"):
            t = getattr(self, name).astype(np.float64)
            flat = t - (t * normal).sum(axis=1, keepdims=True) * normal
            flat *= np.linalg.norm(t, axis=1, keepdims=True) / np.linalg.norm(flat, axis=1, keepdims=True)
            tangents[name] = flat.astype(getattr(self, name).dtype)
        return replace(self, center=rounded.astype(self.center.dtype), **tangents)

    def take(self, ids: ArrayLike | slice) -> Splats:
        """Return the splats selected by `ids` (indices, a mask or a slice), in that order."""
        key: Any = ids if isinstance(ids, slice) else np.asarray(ids)
        if not isinstance(key, slice) and not key.size:
            key = key.astype(np.intp)
        fields = ("center", "tangent_u", "tangent_v", "color", *OPTIONAL)
        taken = {name: getattr(self, name)[key] for name in fields if getattr(self, name) is not None}
        named = {name: values[key] for name, values in self.attributes.items()}
        return replace(self, **taken, attributes=named, on_invalid="error")


AREA = "an area |t_u x t_v|"
REASONS = ("", "a non-finite number", "a number beyond 1e15", f"{AREA} below 1e-15", f"{AREA} above 1e19")


def invalid_splats(
    center: NDArray[Any], tangent_u: NDArray[Any], tangent_v: NDArray[Any], color: NDArray[Any]
) -> NDArray[np.uint8]:
    """Return (N,) uint8 indices in `REASONS`: 0 for a valid splat, else the index of its problem."""
    columns = (center, tangent_u, tangent_v, color)
    reason = np.empty(len(center), np.uint8)
    for start in range(0, len(center), BLOCK):
        rows = slice(start, start + BLOCK)
        reason[rows] = _reasons(*(column[rows].T for column in columns))
    return reason


def _reasons(
    center: NDArray[Any], tangent_u: NDArray[Any], tangent_v: NDArray[Any], color: NDArray[Any]
) -> NDArray[np.uint8]:
    """Return (N,) uint8 indices in `REASONS` for (3, N) columns."""
    columns = (center, tangent_u, tangent_v, color)
    ux, uy, uz, vx, vy, vz = (*tangent_u.astype(np.float64), *tangent_v.astype(np.float64))
    with np.errstate(invalid="ignore", over="ignore"):
        x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        area = np.sqrt(x * x + y * y + z * z)
        has_area, fits = area >= MIN_AREA, area <= MAX_AREA
        if has_area.all() and fits.all() and all(np.abs(column).max() <= MAX_MAGNITUDE for column in columns):
            return np.zeros(len(x), np.uint8)
        finite = np.logical_and.reduce([np.isfinite(c).all(axis=0) for c in columns])
        small = np.logical_and.reduce([(np.abs(c) <= MAX_MAGNITUDE).all(axis=0) for c in columns])
    return np.select([~finite, ~small, ~has_area, ~fits], [1, 2, 3, 4], 0).astype(np.uint8)


def describe_reasons(reason: NDArray[np.uint8], reasons: Sequence[str], noun: str) -> str:
    """Describe the invalid items in words: their number, the number for each problem, and the first index.

    `reason` is (N,) uint8 indices in `reasons`, 0 for a valid item; `noun` names an item: "splat".
    """
    parts = [f"{count} with {text}" for text, count in reason_counts(reason, reasons)]
    first = int(np.flatnonzero(reason)[0])
    return f"{np.count_nonzero(reason)} of {len(reason)} {noun}s ({', '.join(parts)}; the first is {noun} {first})"


def reason_counts(reason: NDArray[np.uint8], reasons: Sequence[str]) -> list[tuple[str, int]]:
    """Return each problem that occurs in `reason`, and its number of items."""
    return [(reasons[r], int(count)) for r, count in enumerate(np.bincount(reason)) if r and count]


def _half(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Round values to IEEE half precision."""
    return values.astype(np.float16).astype(np.float64)


def _optional_reasons(array: NDArray[Any]) -> NDArray[np.uint8]:
    """Return (N,) uint8 indices in `REASONS` for the rows of an optional array; 0 for a valid row."""
    rows = array.reshape(len(array), int(np.prod(array.shape[1:])))
    with np.errstate(invalid="ignore"):
        finite, small = np.isfinite(rows).all(axis=1), (np.abs(rows) <= MAX_MAGNITUDE).all(axis=1)
    return np.select([~finite, ~small], [1, 2], 0).astype(np.uint8)


def _rows(name: str, value: ArrayLike, *size: int) -> NDArray[Any]:
    """Copy `value` to a float array of shape (N, *size), or raise `InvalidSplatsError`."""
    array = float_array(name, value)
    if array.ndim != 1 + len(size) or array.shape[1:] != size:
        wanted = ", ".join(["N", *map(str, size)]) + "," * (not size)
        raise InvalidSplatsError(f"{name} has shape {array.shape}; it must be ({wanted})")
    # The caller's later writes must not change the splats, and the device needs native, contiguous arrays.
    return np.array(array, dtype=array.dtype.newbyteorder("="), order="C", copy=True)


def float_array(name: str, value: ArrayLike) -> NDArray[Any]:
    """Convert `value` to a float array: float32 and float64 are kept, other types become float64.

    Raises
    ------
    InvalidSplatsError
        `value` is not numeric; the message starts with `name`.
    """
    try:
        array = np.asarray(value)
        return array if array.dtype in (np.float32, np.float64) else array.astype(np.float64)
    except (TypeError, ValueError) as error:
        raise InvalidSplatsError(f"{name} must be an array of numbers ({error})") from None
