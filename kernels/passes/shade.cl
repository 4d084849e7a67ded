// The shading pass: shade each pixel once from the resolved G-buffer. A work-item takes LANES pixels of a row.
//
// SHADER  the header with shade_surface() or, if it defines TAKES_PIXELS, shade_pixels(), which also reads neighbors
// GLOSS   bit 0 and bit 1: the first and second of the three channels of `gloss` replace the material's specular
//         coefficient and shininess

#include "arithmetic/reals.h"
#include "arithmetic/vectors.h"
#include "arithmetic/lanes.h"
#include "shading/surface.h"
#include "shading/gbuffer.h"
#include SHADER

#ifdef TAKES_PIXELS
#define SHADED shade_pixels(&s, shading, lights, &at, npr, tones)
#else
#define SHADED shade_surface(&s, shading, lights)
#endif

#define PIXELS                                                                              \
  const Pixels at = {AS_GBUFFER, view, (int)get_global_id(0) * LANES, get_global_id(1)};    \
  const int num = least(LANES, view->width - at.x);                                         \
  const long first = (long)at.y * view->width + at.x;                                       \
  surfaces s = surface_at(&at)

kernel void shade(constant View *view, constant Shading *shading, constant PhongLight *lights, constant Npr *npr,
                  constant real *tones, GBUFFER, global const real *gloss, global real *color LIGHT_ARGUMENTS)
{
  PIXELS;
  TAKE_LIGHT_ARGUMENTS(s);
  s.specular = (reals)shading->specular;
  s.shininess = (reals)shading->shininess;
#if GLOSS
  long p[LANES];
  pixel_indices(&at, 0, 0, p);
#endif
#if GLOSS & 1
  s.specular = (reals)EACH_LANE(X_AT, gloss);
#endif
#if GLOSS & 2
  s.shininess = (reals)EACH_LANE(Y_AT, gloss);
#endif
  const reals3 zero = {R(0.0), R(0.0), R(0.0)};
  const reals3 rgb = ANY(s.covered) ? select3(zero, SHADED, s.covered) : zero;
  for (int lane = 0; lane < num; ++lane) {
    const long p = first + lane;
    color[4 * p] = LANE_OF(rgb.x, lane);
    color[4 * p + 1] = LANE_OF(rgb.y, lane);
    color[4 * p + 2] = LANE_OF(rgb.z, lane);
    color[4 * p + 3] = WHOLE_OF(s.covered, lane) ? R(1.0) : R(0.0);
  }
}

#if !RESOLVED
static inline void store3(global real *out, long p, reals3 v, int lane)
{
  out[3 * p] = LANE_OF(v.x, lane);
  out[3 * p + 1] = LANE_OF(v.y, lane);
  out[3 * p + 2] = LANE_OF(v.z, lane);
}

// Write the surface itself: the AOVs P, N, albedo and both depths.
kernel void shade_resolve(constant View *view, GBUFFER, global real *position, global real *normal,
                          global real *albedo, global real *mean_depth, global real *distance)
{
  PIXELS;
  for (int lane = 0; lane < num; ++lane) {
    const long p = first + lane;
    store3(position, p, s.position, lane);
    store3(normal, p, s.normal, lane);
    store3(albedo, p, s.albedo, lane);
    mean_depth[p] = LANE_OF(s.mean_depth, lane);
    distance[p] = LANE_OF(s.distance, lane);
  }
}
#endif
