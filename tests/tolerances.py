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

# ---- the kernels against the oracle

DOUBLE_UNITS = MARGIN_UNITS * 2.0**-29
"""MARGIN_UNITS for float64 kernels: 2^-53 / 2^-24 smaller."""

MASKED = {"near_plane": 0.04, "giant": 0.12}
MASKED_OTHERWISE = 0.01
"""Largest share of an image's covered pixels whose decisions may be left out, by scene (seen: 3.4 % near the eye,
8 % of giant discs, 0.9 % of every other scene)."""

DEPTH_RELATIVE = 2e-6
"""Depth outside the mask, of depth (seen: 1.3e-6 on ordinary scenes)."""

DEPTH_UNITS = 4.0
"""Depth of ill-conditioned splats, in float roundings of the oracle's first-order scale; the larger of this and
DEPTH_RELATIVE holds. Beyond DEPTH_RELATIVE are discs within a degree of edge-on, whose z changes much within a
pixel, and discs described from a point far outside the image."""

RESOLVED = 1e-5
"""Resolved colour, unnormalised normal and mean depth outside the mask (seen: 1.3e-6)."""

RESOLVED_NEEDLES = 3e-5
"""The same for needles of aspect 30 to 10 000, where r itself is off by 2^-24 times the aspect (seen: 1.8e-5)."""

WEIGHT_RELATIVE = 5e-5
"""Weight of the weight: the error of r^2, times cutoff^2 / 2, does not cancel as it does when a colour is resolved
(seen: 1.8e-5)."""

WEIGHT_ADVERSARIAL = 5e-4
"""The same for ill-conditioned scenes (seen: 2.8e-4 for needles)."""

DOUBLE_RELATIVE = 1e-12
"""All of these with float64 kernels, ordinary scenes (seen: 2.6e-13 weight, 1.6e-14 others). An error in the
algebra, the exponential or a constant rounded to float32 would be far above it."""

DOUBLE_ADVERSARIAL = 2e-11
"""The same, ill-conditioned scenes (seen: 6.3e-12 weight, 1.3e-12 others)."""

# ---- the records of the projection

REFERENCE_PIXELS = {"single": 5e-8, "double": 1e-11}
"""The projected centre, pixels: float32 kernels compute it to 48 bits and round its offset from a pixel once
(seen: 1.5e-8); float64 kernels are compared with a float64 oracle (seen: 1e-12)."""

COEFFICIENT_UNITS = 5.0
"""Coefficients of u, v and z, in roundings of the products that they are differences of (seen: 1.4)."""

NORMAL_UNITS = 16.0
"""Unit normals: a cross product of rotated tangents, in roundings, for tangents at right angles."""

PREFILTER_POINT_UNITS = 8.0
"""The bounds' centre as the pre-filter's, in units of the oracle's estimate of its float32 error."""

BOUNDS_LOOSER = 0.02
"""Pixels by which a record's bounds may exceed the exact ones (their own slack is 0.0078)."""

BOUNDS_LOOSER_SIZE = 2e-5
"""The same, of the bounds' size (their own slack is 3.8e-6)."""

BOUNDS_LOOSER_TILT = 2e-6
"""The same, of size / cos(tilt) (their own slack is 9.5e-7)."""

# ---- shading

SHADED_SINGLE = 1e-6
"""Resolved and shaded values of about 1 to 10 from the same sums: a few roundings, times the shininess for Phong's
power."""

SHADED_DOUBLE = 1e-13
"""The same in float64 (seen: 4e-15; the power's series stops at 1e-16)."""

SPECULAR_EDGE = 1e-5
"""|N.L| below which Phong's highlight may be on or off: R.V does not fade there."""

# ---- closed forms on the device

DEPTH_BY_HAND = 3e-7
"""A plane's depth at a pixel: the few float32 roundings of one intersection."""

WEIGHT_BY_HAND = 2e-7
"""The kernels' own exponential: about one unit in the last place, and r^2 exact."""

EXPONENTIAL_ULPS = 1.5
"""Relative error of the kernels' exponential, in machine epsilons."""

CONSTANT_COLOR_ULPS = 8.0
"""Resolved constant colour: the rounding errors of two sums of about fifty terms do not cancel (seen: 6)."""

# ---- invariants

PERMUTED = 1e-5
"""Sums of up to a hundred positive terms in another order, relative."""

# ---- real scans

MASKED_SCAN = 0.001
"""Largest share of covered pixels that the whole mask (acceptance and front-most splat) may leave out of a comparison
of a scan of points: the project's target (seen: 0.066 % of the three bundled scans, 0.098 % of others). Of a mesh it
holds for the acceptance alone: coplanar splats tie (MASKED_ID_MESH)."""

MASKED_DENSE_SCAN = 0.03
"""The same with up to fifty fragments per pixel, any of which may be nearly tied (seen: 2.5 %)."""

ID_UNITS = 2.0
"""Margin of which splat is front-most, on scans: it is relative to the sum of the two depths' error scales, and depths
of ordinary splats err by less (seen: flips up to 1.1)."""

MASKED_ID_MESH = 0.08
"""The whole mask of meshes (seen: 6.4 %): splats of one triangle are coplanar and tie exactly wherever they overlap, so
that float32 cannot tell which is in front."""

# ---- estimated splats

SPHERE_NORMAL_DEGREES = 1.0
"""Normals of 4000 even points on a sphere: the plane through a patch of 20 is tilted by its unevenness (0.3 is
seen)."""

GRID_OVERLAP = 1.8
"""Disc area per surface on a regular grid: a disc around a square cell covers pi/2 of it, times the 1.05^2 margin."""

JITTERED_OVERLAP = 2.2
"""The same where points are off the grid by up to 0.3 spacings: cells are irregular (2.13 is seen)."""

RANDOM_OVERLAP = 2.7
"""The same for uniformly random points, whose cells vary most (2.50 is seen)."""

RANDOM_UNCOVERED = 2e-4
"""Share of a randomly sampled surface in voids wider than 20 neighbours reveal (3e-5 is seen)."""

BOUNDARY_RADIUS = 2.5
"""Largest disc at a grid's boundary, in spacings: 1.75 times the distance to the 6th neighbour (sqrt 2 here)."""

TRANSLATED_RELATIVE = 1e-6
"""Estimates at survey coordinates (1e6): float64 leaves 1e-10 of them, and cells are found in float32 (1e-7)."""

RIM_RELATIVE = 1e-9
"""A triangle's corners on its ellipse, in float64, for aspects up to 1000."""

# ---- colours

COLOR_ABSOLUTE = 1e-6
"""Hand-computed sRGB values are given to 7 digits, and the result is float32."""

# ---- the probe

PROBED_DISC = 2e-5
"""u, v and z of a probed splat against a solved 3x3 system, for the discs of a sphere up to its silhouette, where u
and v err by 2^-24 / cos (seen: 3e-6)."""

# ---- the OpenGL backend (examples/backend_gl)

GL_CLOSE = 1e-4
"""Z of its size, weight of its size, colours and normals: plain float32 in the vertex shader puts projected centres
off by up to 3e-5 pixels of splats a pixel or two in radius (seen: 2e-6 at most pixels)."""

GL_DIFFERENT = 0.002
"""Largest share of covered pixels beyond that: decisions at rims and at depth + epsilon that fall otherwise, and
discs near edge-on (seen: 0.07 % by weight, 0.03 % by Z and colour)."""

# ---- margins and envelopes from the device against the host's

DEVICE_MARGIN = 1e-5
"""Both are computed in float64, whose rounding is 2^-29 units; seen is float32's rounding of the result alone."""

SURVEY_MARGIN = 5e-3
"""The same for coordinates of 4e6, which the host rotates as they are: 1e-9 of 6 (1e-3 is seen). The device takes an
origin away first."""

DEVICE_RELATIVE = 2.0**-22
"""Two roundings to float32."""

# ---- shaders

NPR_TIES = 1e-5
"""Relative change of the light and the contour, absolute one of the silhouette's cosine, below which float32 may choose
another tone or draw another line: each is a few roundings of numbers of about 1."""

NPR_TIES_SHARE = 0.01
"""Of the pixels, whose tone or line is that near to another (0.1 % are seen)."""

USER_SHADED = 3e-5
"""Phong written by a user, by OpenCL's own pow: 16 units in the last place, times float32's rounding of its argument,
times the shininess of 32."""

# ---- clip lines and sharp features

FEATURE = 1e-9
"""Float64 lines of edges in disc coordinates and in space, for planes at more than a degree (seen: 1e-12), and the
pixels between the two projections of one edge."""

FEATURE_SAMPLED = 2e-3
"""Least value of a line over what is left of a disc, against 20 000 samples of the disc, which lie about 0.01 apart
and meet a corner less closely than that (seen: 5e-4 with samples on the rim and the lines)."""

FEATURE_SPILL = 2e-6
"""How far a splat may reach over an edge: features.lines.LEAST_CUT of a radius below 1, twice."""

# ---- the papers' claims, rerun

KERNEL_AREA = 0.02
"""Relative: a kernel's area in pixels, of an ellipse of over 70, against its closed form: counting errors of rims."""

MOMENT_RELATIVE = 2e-3
"""Second moments of a Gaussian of 4 pixels' deviation, sampled at pixel centres and cut at 6 deviations."""

# ---- supersampling

SUPERSAMPLED_ROUNDING = 1e-6
"""Means of float32 numbers of about 1, summed in another order, rounded to float32: an ulp; a few more for normals, as
random ones nearly cancel."""

SUPERSAMPLED = WEIGHT_RELATIVE
"""Means over the samples of a pixel err no more than the worst of them."""

SUPERSAMPLED_COLOR = 1e-4
"""Phong's power multiplies the error of a normal (RESOLVED) by the shininess, 32."""

SUPERSAMPLED_MASKED = 0.04
"""MASKED_OTHERWISE for each of the 2 x 2 samples."""

# ---- methods other than [BHZK05]'s (tests/test_methods.py, tests/test_footprints.py)

MASKED_METHODS = 0.02
"""Largest share of covered pixels left out: ellipses decide twice, whether they cover and whether the disc does (seen:
1.7 % with the eye among the discs, below 0.5 % otherwise)."""

SINGLE_METHODS = 4e-6
"""Depth, relative: DEPTH_RELATIVE, twice that with discs about the eye, as DEPTH_UNITS allows (seen: 2.3e-6)."""

COLOR_LIT = 3e-5
"""Phong's power multiplies a normal's error by the shininess (seen: 2.3e-6)."""

BOX_SLACK = 0.02
"""Pixels from a pixel's centre within which a box's end may take it along or not (BOUNDS_LOOSER)."""

DOUBLE_METHODS = 1e-12
"""All of these in float64 (seen: 5e-14)."""

TARGET_STEPS = {"float16": 2.0**-8, "unorm8": 2.5 / 255}
"""A weight on the border of two steps may fall to either: a step or two of a sum of a few."""
# ---- normal fields

FIELD_OF_CONSTANT = 0.01
"""Error of a sphere's normal at the rim with a field, of that without, where a disc is 3 degrees in radius: the third
order is 0.0014 times the first, and estimates feel the unevenness of their neighbours (seen: 0.003)."""

FIELD_EXACT = 1e-9
"""A field that is exact, from normals in float64."""

# ---- decimation

BOUND_SLACK = 1e-9
"""Float64 rounding of heights and disc coordinates, relative; an output ellipse is computed to hold what it covers."""

BOUND_SLACK_SINGLE = 1e-5
"""The same of float32 output, in error bounds of a hundredth of the coordinates, which are rounded by up to 6e-8 of
them, and in cosines."""

BOUND_SLACK_SURVEY = 1e-7
"""The same at coordinates of 5e6, which float64 rounds by up to 5e-10, in error bounds of 0.1."""
# ---- lights

SHADOW_GAP = 1e-5
"""Scene units between a place and map + bias within which a lookup may fall either way, for scenes of size 3: a place
and its depth in the light's space are off by a few float32 roundings of 3 (seen: 5e-7). Times 2^-29 in float64."""

SHADOW_TEXELS = 1e-3
"""Texels from a texel's edge within which the nearest lookup may ask its neighbour: the same error in maps of 64
(seen: 2e-5)."""

SHADOWED_EITHER = 0.02
"""Largest share of the covered pixels that those two and the maps' own margins may leave out (seen: 0.6 %)."""

SHADOWED_SINGLE = 2e-5
"""Colours outside of those: filtered lookups change by one over one texel, whose place is off by 1e-5 (seen: 4e-6)."""

LIGHTMAP_SINGLE = 2e-6
"""Colours from the light map against the same lookups in float64: a place on the map is off by 64 roundings of 2^-24,
and the lights' sum changes by 0.03 from one sample to the next (seen: 3e-7)."""

LIGHTMAP_PHONG = 0.012
"""Diffuse and specular sums of lights of colour 1 against exact Phong, for a shininess of 32: samples are h = 0.016 to
0.04 apart, the highlight's curvature 32 makes 32 h^2 / 8, the diffuse light's edge h / 4 (seen: 0.006)."""

ENVIRONMENT = 0.01
"""Irradiance of an even environment: 16 rows of lights are a sum for an integral (seen: 0.002)."""
