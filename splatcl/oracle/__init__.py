"""The passes in float64 NumPy, written from docs/specification.md: every splat against every pixel, no tiles.

An independent second opinion for the kernels: slow, plain, sharing no code with them.

The margin
----------
Where a decision is nearly a tie, a float32 renderer may decide it otherwise than this one. Each decision has
a signed margin, (distance from flipping) / (2^-24 scale), positive where it accepts; `scale` is, to first
order, the rounding error of a float32 evaluation relative to the projected centre, in units of 2^-24. With
s = ((x-cx)/fx, (y-cy)/fy, 1), s_c the same at the projected centre, e_i = |s_i - s_c,i| + 2 pixels (whose
rounding error is 2^-24 e_i), den = g.s / g.s_c, A = a / g.s_c, B = b / g.s_c and G = g / g.s_c:

- r3^2 <= 1 and z > 0:  den - |(A.s, B.s)| >= 0, scale sum_i (|A_i| + |B_i| + |G_i|) e_i + 1 + kappa;
- near <= z <= far:  scale_z = |z| (1 + (1 + kappa) sum_i |G_i| e_i) / |den|
  (orthographic: |z| + (1 + kappa) sum_i |g_i / g_z| e_i), and |z| for the centre's z;
- r2^2 <= 1:  scale 2 r2^2 + 4 r2 (error of the pre-filter's centre in 2^-24 pixels) / prefilter_radius;
- z <= depth + epsilon:  scale_z of the fragment, plus that of the front-most splat, plus epsilon;
- which splat is front-most:  the difference of the two z, scale the sum of their scale_z;
- facing (cos = n.c / |c|, n_z if orthographic) and edge-on (|cos| - 2^-16):  scale
  4 |t_u| |t_v| / |t_u x t_v|;
- a clip line's a u + b v + c >= 0:  times den as r3, of the same scale;
- r <= 1 in an ellipse (splatcl/oracle/geometry/ellipses.py):  the scale of `cover`; that a conic one exists:
  4 (|z| + reach);

kappa = max(|t_u|, |t_v|)^2 / |t_u x t_v| / |cos| is the relative error of g.s_c (of a circle, 1/|cos|).
Conditions that hold together (r3^2 <= 1, z in [near, far], not edge-on, not culled, not cut off) have the least of
their signed margins, so a splat lowers the margin only of pixels that it touches or nearly touches; a disc wholly and
clearly outside [near, far] lowers none. Where a fragment of an ellipse is, whether its ray meets the disc decides its
depth, and counts too.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from splatcl.oracle import attributes, project, shade, shadow, supersampling, visibility
from splatcl.oracle.buffers import Array
from splatcl.scene.camera import Camera
from splatcl.scene.settings import RenderSettings
from splatcl.scene.splats import Splats

__all__ = ["auto_epsilon", "passes", "render"]


def auto_epsilon(splats: Splats) -> float:
    """Return the median of max(|t_u|, |t_v|), scene units; 0 for no splats."""
    return float(np.median(splats.radius)) if len(splats) else 0.0


def passes(splats: Splats, camera: Camera, settings: RenderSettings, epsilon: float) -> dict[str, Array]:
    """Run all passes; return what `render` does, but with two margins.

    `margin` leaves out which of several splats is front-most (coplanar ones tie everywhere); `id_margin` is of the
    visibility pass, that included. `epsilon` is in scene units.
    """
    projected = project.project(splats, camera, settings)
    depth = visibility.visibility(projected, camera, settings)
    names = list(splats.attributes)
    channels = np.stack([splats.attributes[name] for name in names], axis=1) if names else None
    gloss = _gloss(splats.attributes, settings, len(splats))
    gbuffer = attributes.attributes(projected, depth, camera, settings, epsilon, splats.color, channels, gloss)
    with np.errstate(invalid="ignore", divide="ignore"):
        means = np.nan_to_num(gbuffer.channel_sum / gbuffer.weight_sum[..., None])
    named = {name: means[..., k] for k, name in enumerate(names)}
    pixel_gloss = _gloss(named, settings, gbuffer.weight_sum.shape)
    shadows = shadow.shadow_maps(splats, settings, epsilon)
    return {
        **shade.shade(gbuffer, depth, camera, settings, pixel_gloss, epsilon, shadows),
        "Z": depth.depth,
        "weight": gbuffer.weight_sum,
        "count": gbuffer.count,
        "particleid": depth.particleid,
        **{f"attribute.{name}": values for name, values in named.items()},
        "margin": np.minimum(depth.depth_margin, gbuffer.margin),
        "id_margin": depth.margin,
    }


def _gloss(named: Mapping[str, Array], settings: RenderSettings, shape: int | tuple[int, ...]) -> Array | None:
    """(..., 2) specular and shininess, None where the material's hold everywhere."""
    if not {"specular", "shininess"} & named.keys():
        return None
    material = settings.material
    default = {"specular": material.specular, "shininess": material.shininess}
    return np.stack([named.get(name, np.full(shape, value)) for name, value in default.items()], axis=-1)


def render(splats: Splats, camera: Camera, settings: RenderSettings) -> dict[str, Array]:
    """Run all passes; return the image and its AOVs, each (H, W) or (H, W, channels)."""
    n, epsilon = settings.supersampling, auto_epsilon(splats) if settings.epsilon == "auto" else settings.epsilon
    aovs = passes(splats, camera if n == 1 else supersampling.enlarged(camera, n), settings, epsilon)
    aovs["margin"] = np.minimum(aovs["margin"], aovs.pop("id_margin"))
    return aovs if n == 1 else supersampling.averaged(aovs, n)
