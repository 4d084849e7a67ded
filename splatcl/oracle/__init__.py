"""Oracle: the passes in float64 NumPy, every splat against every pixel, without tiles.

It is an independent second opinion for the kernels: written from docs/specification.md, slow, plain, and without shared
code. `render` and `passes` run all passes; each pass is a module with a function of the same name.

Margins
-------
A float32 renderer may decide a near tie otherwise than the oracle. Each decision therefore has a signed margin,

    margin = distance from flipping / (2^-24 scale),

positive where the decision accepts. The scale is, to first order, the rounding error of a float32 evaluation relative
to the projected center, in units of 2^-24. The symbols are:

- s = ((x - cx) / fx, (y - cy) / fy, 1), and s_c the same at the projected center;
- e_i = |s_i - s_c,i| + 2 pixels, whose rounding error is 2^-24 e_i;
- den = g.s / g.s_c, A = a / g.s_c, B = b / g.s_c and G = g / g.s_c, with a, b and g of geometry/discs.py;
- cos = n.c / |c|, or n_z if orthographic;
- kappa = max(|t_u|, |t_v|)^2 / |t_u x t_v| / |cos|, the relative error of g.s_c; for a circle it is 1 / |cos|.

Each decision has its scale:

- r3^2 <= 1 and z > 0, that is den - |(A.s, B.s)| >= 0:  sum_i (|A_i| + |B_i| + |G_i|) e_i + 1 + kappa;
- near <= z <= far:  scale_z = |z| (1 + (1 + kappa) sum_i |G_i| e_i) / |den|, or orthographic
  |z| + (1 + kappa) sum_i |g_i / g_z| e_i;  for the center's z it is |z|;
- r2^2 <= 1:  2 r2^2 + 4 r2 (error of the pre-filter's center in 2^-24 pixels) / prefilter_radius;
- z <= depth + epsilon:  scale_z of the fragment, plus scale_z of the front-most splat, plus epsilon;
- which splat is front-most:  the sum of both splats' scale_z, for the difference of their z;
- facing, cos >= 0, and edge-on, |cos| <= 2^-16:  4 |t_u| |t_v| / |t_u x t_v|;
- the square point of sprite="point", half its side less the distance:  4 times half its side, the distance and 2;
- a clip line a u + b v + c >= 0:  that of r3, for the line times den;
- r <= 1 in an ellipse:  see `cover` in geometry/ellipses.py;
- a conic ellipse exists:  4 (|z| + reach), with reach = |(t_u,z, t_v,z)|.

Some conditions must hold together: r3^2 <= 1, z in [near, far], not edge-on, not culled, not clipped. They take the
least of their signed margins. A splat thus lowers the margin only of pixels that it touches or nearly touches. A disc
that is wholly and clearly outside [near, far] lowers none. A fragment of an ellipse takes its depth from the disc if
its ray meets the disc, so that decision counts too.
"""

from __future__ import annotations

import numpy as np

from splatcl.oracle import attributes, project, shade, shadow, supersampling, visibility
from splatcl.oracle.buffers import Array
from splatcl.scene.camera import Camera
from splatcl.scene.settings import RenderSettings
from splatcl.scene.splats import Splats

__all__ = ["auto_epsilon", "passes", "render"]


def auto_epsilon(splats: Splats) -> float:
    """Return the depth tolerance of epsilon="auto", scene units: the median of max(|t_u|, |t_v|); 0 for no splats."""
    return float(np.median(splats.radius)) if len(splats) else 0.0


def passes(splats: Splats, camera: Camera, settings: RenderSettings, epsilon: float) -> dict[str, Array]:
    """Run all passes once, without supersampling.

    Parameters
    ----------
    splats
        World space.
    epsilon
        Depth tolerance, scene units; it replaces `settings.epsilon`.

    Returns
    -------
    dict
        AOVs by their names (docs/specification.md), each (H, W) or (H, W, channels), float64 but for `count` and
        `particleid`, which are uint32. `margin` (H, W) leaves out the choice of the front-most splat, since coplanar
        splats always tie. `id_margin` (H, W) is that of the visibility pass with this choice.
    """
    projected = project.project(splats, camera, settings)
    depth = visibility.visibility(projected, camera, settings)
    gbuffer = attributes.attributes(projected, depth, splats, camera, settings, epsilon)
    shadows = shadow.shadow_maps(splats, settings, epsilon)
    return {
        **shade.shade(gbuffer, depth, camera, settings, epsilon, shadows),
        "Z": depth.depth,
        "weight": gbuffer.weight_sum,
        "count": gbuffer.count,
        "particleid": depth.particleid,
        "margin": np.minimum(depth.depth_margin, gbuffer.margin),
        "id_margin": depth.margin,
    }


def render(splats: Splats, camera: Camera, settings: RenderSettings) -> dict[str, Array]:
    """Run all passes, with supersampling; return the AOVs of `passes`, but with one `margin` of all decisions."""
    n, epsilon = settings.supersampling, auto_epsilon(splats) if settings.epsilon == "auto" else settings.epsilon
    aovs = passes(splats, camera if n == 1 else supersampling.enlarged(camera, n), settings, epsilon)
    aovs["margin"] = np.minimum(aovs["margin"], aovs.pop("id_margin"))
    return aovs if n == 1 else supersampling.averaged(aovs, n)
