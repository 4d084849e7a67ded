// Shading pass: once per pixel, from the resolved G-buffer. SHADER names the header with shade_surface().
// A work-item takes LANES pixels of a row.

#include "arithmetic.h"
#include "lanes.h"
#include "surface.h"
#include SHADER

#define GBUFFER                                                                                              \
  global const real *depth, global const real *weight_sum, global const real *color_sum,                     \
      global const real *normal_sum, global const real *depth_sum

#define PLANE(lane, values) values[p[lane]]
#define X(lane, values) values[3 * p[lane]]
#define Y(lane, values) values[3 * p[lane] + 1]
#define Z(lane, values) values[3 * p[lane] + 2]
#define TRIPLE(values) {(reals)EACH_LANE(X, values), (reals)EACH_LANE(Y, values), (reals)EACH_LANE(Z, values)}

// `p`: where the pixels are; those beyond the row's end are its last again.
static inline Surface surface_at(constant View *view, int x, int y, const long *p, GBUFFER)
{
  const reals3 colors = TRIPLE(color_sum), normals = TRIPLE(normal_sum);
  reals columns;
  for (int lane = 0; lane < LANES; ++lane) ((real *)&columns)[lane] = (real)(x + lane);
  return resolve_surface(view, columns, (reals)(real)y, (reals)EACH_LANE(PLANE, depth),
                         (reals)EACH_LANE(PLANE, weight_sum), colors, normals, (reals)EACH_LANE(PLANE, depth_sum));
}

#define PIXELS                                                          \
  const int x = get_global_id(0) * LANES, y = get_global_id(1);         \
  const int num = least(LANES, view->width - x);                        \
  long p[LANES];                                                        \
  for (int lane = 0; lane < LANES; ++lane) p[lane] = (long)y * view->width + x + least(lane, num - 1)

static inline void store3(global real *out, long p, reals3 v, int lane)
{
  out[3 * p] = LANE_OF(v.x, lane);
  out[3 * p + 1] = LANE_OF(v.y, lane);
  out[3 * p + 2] = LANE_OF(v.z, lane);
}

// GLOSS: bit 0 and 1 say that the first or second of the three channels of `gloss` stands for the material's specular
// coefficient or shininess.
kernel void shade(constant View *view, constant Shading *shading, constant PhongLight *lights, GBUFFER,
                  global const real *gloss, global real *color LIGHT_ARGUMENTS)
{
  PIXELS;
  Surface s = surface_at(view, x, y, p, depth, weight_sum, color_sum, normal_sum, depth_sum);
  TAKE_LIGHT_ARGUMENTS(s);
  s.specular = (reals)shading->specular;
  s.shininess = (reals)shading->shininess;
#if GLOSS & 1
  s.specular = (reals)EACH_LANE(X, gloss);
#endif
#if GLOSS & 2
  s.shininess = (reals)EACH_LANE(Y, gloss);
#endif
  const reals3 zero = {R(0.0), R(0.0), R(0.0)};
  const reals3 rgb = ANY(s.covered) ? select3(zero, shade_surface(&s, shading, lights), s.covered) : zero;
  for (int lane = 0; lane < num; ++lane) {
    color[4 * p[lane]] = LANE_OF(rgb.x, lane);
    color[4 * p[lane] + 1] = LANE_OF(rgb.y, lane);
    color[4 * p[lane] + 2] = LANE_OF(rgb.z, lane);
    color[4 * p[lane] + 3] = WHOLE_OF(s.covered, lane) ? R(1.0) : R(0.0);
  }
}

kernel void resolve(constant View *view, GBUFFER, global real *position, global real *normal, global real *albedo,
                    global real *mean_depth, global real *distance)
{
  PIXELS;
  const Surface s = surface_at(view, x, y, p, depth, weight_sum, color_sum, normal_sum, depth_sum);
  for (int lane = 0; lane < num; ++lane) {
    store3(position, p[lane], s.position, lane);
    store3(normal, p[lane], s.normal, lane);
    store3(albedo, p[lane], s.albedo, lane);
    mean_depth[p[lane]] = LANE_OF(s.mean_depth, lane);
    distance[p[lane]] = LANE_OF(s.distance, lane);
  }
}
