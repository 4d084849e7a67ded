"""Every tolerance of the tests, with the reason for its size. A test without a name from here is exact."""

# ---- the float64 oracle against closed forms

ORACLE_RELATIVE = 1e-12
"""A few dozen float64 roundings (1.1e-16 each) of well-conditioned splats leave about 1e-14."""

BOUNDS_RELATIVE = 1e-8
"""Closed-form bounds against the extremes of a sampled rim, polished by a parabola; of the bounds' size."""

AREA_PER_PERIMETER = 0.1
"""Pixels counted inside an ellipse against its area, per pixel of perimeter: counting errors of single rim
pixels largely cancel (about 0.02 is seen); half a pixel of offset or radius would be 0.5."""

# ---- the margin: units of 2^-24 times the decision's scale (see splatcl.oracle)

MARGIN_UNITS = 32.0
"""No float32 evaluation flips a decision whose margin is larger. A million random splats erred by at most 5 units
(ordinary ones) to 25 (radius 0.3 of the distance, 0.6 degrees from edge-on; aspect 100)."""

MARGIN_TYPICAL = 4.0
"""The same for a few hundred random splats: about 2 is seen."""

NOISE_UNITS = 2.0**14
"""Noise put on float64 inputs, in float32 roundings: large enough for decisions to flip, small enough (1e-3) that
first order still holds."""

NOISE_MARGIN = 4.0
"""Flips stay below this many times the noise, for the inputs of one decision can conspire; 1 is seen."""

# ---- Mitsuba 3 (float32)

MITSUBA_MARGIN = 256.0
"""Mitsuba inverts a float32 4x4 matrix per disc and tests in object space, which errs more than evaluating
relative to the projected centre (MARGIN_UNITS): pixels with a smaller margin are left out."""

MITSUBA_EXCLUDED = 0.001
"""Largest share of the pixels that may be left out so."""

MITSUBA_DEPTH = 1e-5
"""Relative depth error of the same: a float32 matrix inverse of discs up to 1:20 and 5 degrees from edge-on."""
