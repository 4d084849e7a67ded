"""Every tolerance of the tests: its unit, its reason and the largest error seen. All other comparisons are exact."""

# ---- the float64 oracle against closed forms

ORACLE_RELATIVE = 1e-12
"""Relative error of the float64 oracle: a few dozen roundings of 1.1e-16 each, of well-conditioned splats. They leave
about 1e-14."""

BOUNDS_RELATIVE = 1e-8
"""Error of closed-form bounds, in units of the bounds' size. The reference is the extremes of a sampled rim, polished
by a parabola."""

AREA_PER_PERIMETER = 0.1
"""Error of an ellipse's area counted in pixels, per pixel of its perimeter (seen: 0.02). Counting errors of rim pixels
largely cancel. Half a pixel of offset or of radius would be 0.5."""

# ---- the margin: in units of 2^-24 times the decision's scale (splatcl/oracle/__init__.py)

MARGIN_UNITS = 32.0
"""Margin above which no float32 evaluation flips a decision. A million random splats erred by at most 5 units, and by
25 in the worst poses: radius 0.3 of the distance, 0.6 degrees from edge-on, aspect 100."""

MARGIN_TYPICAL = 4.0
"""The same margin for a few hundred random splats (seen: 2)."""

NOISE_UNITS = 2.0**14
"""Noise on float64 inputs, in float32 roundings. Decisions flip under it, and it is small enough (1e-3) for first order
to hold."""

NOISE_MARGIN = 4.0
"""Largest margin of a flipped decision, in units of the noise (seen: 1). The inputs of one decision may err
together."""

# ---- Mitsuba 3 (float32)

MITSUBA_MARGIN = 256.0
"""Margin below which a pixel is left out. Mitsuba inverts a float32 4x4 matrix per disc and tests in object space,
which errs more than evaluation relative to the projected center (MARGIN_UNITS)."""

MITSUBA_EXCLUDED = 0.001
"""Largest share of the pixels that MITSUBA_MARGIN leaves out."""

MITSUBA_DEPTH = 1e-5
"""Relative error of Mitsuba's depth, from its float32 matrix inverse: discs up to 1:20, and 5 degrees from edge-on."""

# ---- the kernels against the oracle

DOUBLE_UNITS = MARGIN_UNITS * 2.0**-29
"""MARGIN_UNITS of float64 kernels, whose rounding is 2^-53 instead of 2^-24."""

MASKED = {"near_plane": 0.04, "giant": 0.12}
MASKED_OTHERWISE = 0.01
"""Largest share of the covered pixels that uncertain decisions leave out, by scene. Seen: 3.4 % near the eye, 8 % of
giant discs, 0.9 % of every other scene."""

DEPTH_RELATIVE = 2e-6
"""Relative error of the depth outside the mask (seen: 1.3e-6 on ordinary scenes)."""

DEPTH_UNITS = 4.0
"""Error of the depth of ill-conditioned splats, in float roundings of the oracle's first-order scale. The larger of
this and DEPTH_RELATIVE holds. Two kinds of disc need it: those within a degree of edge-on, whose z changes much within
a pixel, and those described from a point far outside the image."""

RESOLVED = 1e-5
"""Error of the resolved color, the unnormalized normal and the mean depth outside the mask (seen: 1.3e-6)."""

RESOLVED_NEEDLES = 3e-5
"""The same error for needles of aspect 30 to 10 000, whose r is off by 2^-24 times the aspect (seen: 1.8e-5)."""

WEIGHT_RELATIVE = 5e-5
"""Relative error of the weight sum (seen: 1.8e-5). The error of r^2, times cutoff^2 / 2, does not cancel here; it
cancels when a color is resolved."""

WEIGHT_ADVERSARIAL = 5e-4
"""The same error for ill-conditioned scenes (seen: 2.8e-4 for needles)."""

DOUBLE_RELATIVE = 1e-12
"""Relative error of each of these with float64 kernels, ordinary scenes (seen: 2.6e-13 weight, 1.6e-14 the rest). An
error in the algebra or the exponential, or a constant rounded to float32, would be far above it."""

DOUBLE_ADVERSARIAL = 2e-11
"""The same error for ill-conditioned scenes (seen: 6.3e-12 weight, 1.3e-12 the rest)."""

# ---- the records of the projection

REFERENCE_PIXELS = {"single": 5e-8, "double": 1e-11}
"""Error of the projected center, pixels. Float32 kernels compute it to 48 bits and round its offset from a pixel once
(seen: 1.5e-8). Float64 kernels are compared with a float64 oracle (seen: 1e-12)."""

COEFFICIENT_UNITS = 5.0
"""Error of the coefficients of u, v and z, in roundings of the products that they are differences of (seen: 1.4)."""

NORMAL_UNITS = 16.0
"""Error of unit normals, in roundings: a cross product of rotated tangents at right angles."""

PREFILTER_POINT_UNITS = 8.0
"""Error of the bounds' center as the pre-filter's, in units of the oracle's estimate of its float32 error."""

BOUNDS_LOOSER = 0.02
"""Constant part of the excess of a record's bounds over the exact bounds, pixels. SLACK_PIXELS in project.cl is
0.0078."""

BOUNDS_LOOSER_SIZE = 2e-5
"""Part of the excess that grows with the bounds' size, per pixel of size. SLACK_SIZE in project.cl is 3.8e-6."""

BOUNDS_LOOSER_TILT = 2e-6
"""Part of the excess that grows with size / cos(tilt), per pixel. SLACK_TILT in project.cl is 9.5e-7."""

# ---- shading

SHADED_SINGLE = 1e-6
"""Error of resolved and shaded values of about 1 to 10 from equal sums: a few roundings, times the shininess for
Phong's power."""

SHADED_DOUBLE = 1e-13
"""The same error in float64 (seen: 4e-15). The series of the power stops at 1e-16."""

SPECULAR_EDGE = 1e-5
"""|N.L| below which Phong's highlight may be on or off: R.V does not fade out there."""

# ---- closed forms on the device

DEPTH_BY_HAND = 3e-7
"""Relative error of a plane's depth at a pixel: the few float32 roundings of one intersection."""

WEIGHT_BY_HAND = 2e-7
"""Relative error of a weight with an exact r^2: about one unit in the last place of the kernels' exponential."""

EXPONENTIAL_ULPS = 1.5
"""Relative error of the kernels' exponential, in machine epsilons."""

CONSTANT_COLOR_ULPS = 8.0
"""Error of a resolved constant color, units in the last place (seen: 6). The rounding errors of two sums of about fifty
terms do not cancel."""

# ---- invariants

PERMUTED = 1e-5
"""Relative error of sums of up to a hundred positive terms in another order."""

# ---- real scans

MASKED_SCAN = 0.001
"""Largest share of a scan's covered pixels that acceptance and front-most splat leave out: the project's target. Seen:
0.066 % of the three bundled scans, 0.098 % of other scans. For a mesh it holds for the acceptance alone, because
coplanar splats tie (MASKED_ID_MESH)."""

MASKED_DENSE_SCAN = 0.03
"""The same share with up to fifty fragments per pixel, any of which may be nearly tied (seen: 2.5 %)."""

ID_UNITS = 2.0
"""Margin of the choice of the front-most splat, on scans, relative to the sum of both depths' error scales. Depths of
ordinary splats err by less (seen: flips up to 1.1)."""

MASKED_ID_MESH = 0.08
"""Largest share of a mesh's covered pixels that the whole mask leaves out (seen: 6.4 %). The splats of one triangle are
coplanar and tie exactly where they overlap, so float32 cannot tell which is in front."""

# ---- estimated splats

SPHERE_NORMAL_DEGREES = 1.0
"""Error of the normals of 4000 even points on a sphere, degrees (seen: 0.3). The plane through a patch of 20 is tilted
by the patch's unevenness."""

GRID_OVERLAP = 1.8
"""Disc area per area of the surface on a regular grid. A disc around a square cell covers pi/2 of it, times the margin
1.05^2."""

JITTERED_OVERLAP = 2.2
"""The same ratio with points up to 0.3 spacings off the grid: cells are irregular (seen: 2.13)."""

RANDOM_OVERLAP = 2.7
"""The same ratio for uniformly random points, whose cells vary most (seen: 2.50)."""

RANDOM_UNCOVERED = 2e-4
"""Share of a randomly sampled surface that may stay uncovered (seen: 3e-5): voids wider than 20 neighbors reveal."""

BOUNDARY_RADIUS = 2.5
"""Largest radius at a grid's boundary, in spacings: 1.75 times the distance to the 6th neighbor (sqrt 2 here)."""

TRANSLATED_RELATIVE = 1e-6
"""Relative error of estimates at survey coordinates (1e6). Float64 leaves 1e-10 of them; cells are found in float32
(1e-7)."""

RIM_RELATIVE = 1e-9
"""Relative distance of a triangle's corners from its ellipse, in float64, for aspects up to 1000."""

# ---- colors

COLOR_ABSOLUTE = 1e-6
"""Error of linear colors: the sRGB values by hand have 7 digits, and the result is float32."""

# ---- the probe

PROBED_DISC = 2e-5
"""Error of u, v and z of a probed splat against a solved 3x3 system (seen: 3e-6). The discs of the sphere go up to its
silhouette, where u and v err by 2^-24 / cos."""

# ---- the OpenGL backend (examples/backend_gl)

GL_CLOSE = 1e-4
"""Relative error of Z and weight, and error of colors and normals (seen: 2e-6 at most pixels). Plain float32 in the
vertex shader moves projected centers by up to 3e-5 pixels, of splats a pixel or two in radius."""

GL_DIFFERENT = 0.002
"""Largest share of the covered pixels beyond GL_CLOSE (seen: 0.07 % by weight, 0.03 % by Z and color). Decisions at
rims and at depth + epsilon fall otherwise there, or discs are near edge-on."""

# ---- the device's margins and envelopes against the host's

DEVICE_MARGIN = 1e-5
"""Difference of margins, in units. Both sides compute in float64, whose rounding is 2^-29 units; only float32's
rounding of the result is seen."""

SURVEY_MARGIN = 5e-3
"""The same difference for coordinates of 4e6 (seen: 1e-3). The host rotates them as they are: 1e-9 of 6. The device
subtracts an origin first."""

DEVICE_RELATIVE = 2.0**-22
"""Relative difference of envelopes: two roundings to float32."""

# ---- shaders

NPR_TIES = 1e-5
"""Change under which float32 may choose another tone or draw another line. It is relative for light and contour,
absolute for the silhouette's cosine: each is a few roundings of numbers of about 1."""

NPR_TIES_SHARE = 0.01
"""Largest share of the pixels whose tone or line is so close to another (seen: 0.1 %)."""

USER_SHADED = 3e-5
"""Error of Phong written by a user, by OpenCL's own pow: 16 units in the last place, times float32's rounding of the
argument, times the shininess of 32."""

# ---- clip lines and sharp features

FEATURE = 1e-9
"""Error of float64 lines of edges in disc coordinates and in space, for planes at more than a degree (seen: 1e-12).
Also the distance of one edge's two projections, in pixels."""

FEATURE_SAMPLED = 2e-3
"""Difference of a line's least value over the rest of a disc from that over 20 000 samples of the disc (seen: 5e-4 with
samples on the rim and the lines). Samples lie about 0.01 apart and meet a corner less closely."""

FEATURE_SPILL = 2e-6
"""Distance by which a splat may reach over an edge, scene units: prepare.features.clip_lines.LEAST_CUT, twice, of a
radius below 1."""

# ---- the papers' claims

KERNEL_AREA = 0.02
"""Relative error of a kernel's area in pixels against its closed form: counting errors of the rims of ellipses of over
70."""

MOMENT_RELATIVE = 2e-3
"""Relative error of the second moments of a Gaussian of deviation 4 pixels, sampled at pixel centers and cut at 6
deviations."""

# ---- supersampling

SUPERSAMPLED_ROUNDING = 1e-6
"""Error of means of float32 numbers of about 1, summed in another order and rounded to float32: an ulp, and a few more
for normals, because random ones nearly cancel."""

SUPERSAMPLED = WEIGHT_RELATIVE
"""Relative error of means over the samples of a pixel: no more than that of the worst sample."""

SUPERSAMPLED_COLOR = 1e-4
"""Error of a shaded mean: Phong's power multiplies the error of a normal (RESOLVED) by the shininess, 32."""

SUPERSAMPLED_MASKED = 0.04
"""Largest share of the covered pixels left out: MASKED_OTHERWISE for each of the 2 x 2 samples."""

# ---- methods other than [BHZK05]'s (passes/test_methods.py, passes/test_footprints.py)

MASKED_METHODS = 0.02
"""Largest share of the covered pixels left out. Ellipses decide twice: whether they cover, and whether the disc does.
Seen: 1.7 % with the eye among the discs, below 0.5 % otherwise."""

SINGLE_METHODS = 4e-6
"""Relative error of the depth (seen: 2.3e-6): DEPTH_RELATIVE, and twice that with discs about the eye, as DEPTH_UNITS
allows."""

COLOR_LIT = 3e-5
"""Error of a lit color (seen: 2.3e-6): Phong's power multiplies a normal's error by the shininess."""

BOX_SLACK = 0.02
"""Distance from a pixel's center, pixels, within which a box's end may include the pixel or not (BOUNDS_LOOSER)."""

DOUBLE_METHODS = 1e-12
"""Relative error of each of these in float64 (seen: 5e-14)."""

TARGET_STEPS = {"float16": 2.0**-8, "unorm8": 2.5 / 255}
"""Error of a weight sum, by target: a step or two of a sum of a few. A weight on the border of two steps may fall to
either."""

# ---- normal fields

FIELD_OF_CONSTANT = 0.01
"""Error of a sphere's normal at the rim with a field, as a share of the error without (seen: 0.003). For a disc of 3
degrees the third order is 0.0014 times the first, and estimates feel the unevenness of the neighbors."""

FIELD_EXACT = 1e-9
"""Error of a field that is exact, estimated from float64 normals."""

# ---- decimation

BOUND_SLACK = 1e-9
"""Float64 rounding of heights and disc coordinates, relative. An output ellipse is computed to hold the discs that it
covers."""

BOUND_SLACK_SINGLE = 1e-5
"""The same rounding of float32 output. Error bounds are a hundredth of the coordinates, whose rounding is up to 6e-8 of
them; cosines are rounded too."""

BOUND_SLACK_SURVEY = 1e-7
"""The same rounding at coordinates of 5e6, which float64 rounds by up to 5e-10, for error bounds of 0.1."""

# ---- lights

SHADOW_GAP = 1e-5
"""Distance of a place from map + bias within which a lookup may fall either way, scene units, for scenes of size 3
(seen: 5e-7). A place and its depth in the light's space are off by a few float32 roundings of 3. Times 2^-29 in
float64."""

SHADOW_TEXELS = 1e-3
"""Distance from a texel's edge within which the nearest lookup may read the neighbor, texels (seen: 2e-5): the same
error in maps of 64."""

SHADOWED_EITHER = 0.02
"""Largest share of the covered pixels that SHADOW_GAP, SHADOW_TEXELS and the maps' own margins leave out (seen: 0.6
%)."""

SHADOWED_SINGLE = 2e-5
"""Error of the colors of all other pixels (seen: 4e-6). A filtered lookup changes by one over one texel, whose place is
off by 1e-5."""

LIGHTMAP_SINGLE = 2e-6
"""Error of colors from the light map against the same lookups in float64 (seen: 3e-7). A place on the map is off by 64
roundings of 2^-24; the lights' sum changes by 0.03 from one sample to the next."""

LIGHTMAP_PHONG = 0.012
"""Error of the diffuse and specular sums of lights of color 1 against exact Phong, for a shininess of 32 (seen: 0.006).
Samples are h = 0.016 to 0.04 apart: the highlight's curvature 32 makes 32 h^2 / 8, the diffuse light's edge h / 4."""

ENVIRONMENT = 0.01
"""Error of the irradiance of an even environment (seen: 0.002): 16 rows of lights stand for an integral."""
