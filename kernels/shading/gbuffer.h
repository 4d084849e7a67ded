// The images that shading reads, a row's pixels at a time. Needs arithmetic.h, lanes.h, surface.h.
//
// RESOLVED 0: the sums that the attribute pass leaves; 1: the AOVs P, N and albedo, whoever made them, and a weight that
//          is above 0 where there is a surface. Both give the same bits.

#include "arithmetic/reals.h"
#include "arithmetic/divide.h"
#include "arithmetic/vectors.h"
#include "arithmetic/lanes.h"
#include "splat/ray.h"
#include "shading/surface.h"

#ifndef RESOLVED
#error "build option RESOLVED is missing: 0 to shade the sums, 1 to shade AOVs"
#endif

#if RESOLVED
#define GBUFFER                                                                                              \
  global const real *position, global const real *normal, global const real *albedo, global const real *weight
#define AS_GBUFFER {position, normal, albedo, weight}
typedef struct {
  global const real *position, *normal, *albedo, *weight;
} GBuffer;
#else
#define GBUFFER                                                                                              \
  global const real *depth, global const real *weight_sum, global const real *color_sum,                     \
      global const real *normal_sum, global const real *depth_sum
#define AS_GBUFFER {depth, weight_sum, color_sum, normal_sum, depth_sum}
typedef struct {
  global const real *depth, *weight_sum, *color_sum, *normal_sum, *depth_sum;
} GBuffer;
#endif

// LANES pixels of a row and the images they are in; those beyond the row's end are its last again.
typedef struct {
  GBuffer from;
  constant View *view;
  int x, y;
} Pixels;

#define PLANE(lane, values) values[p[lane]]
#define X(lane, values) values[3 * p[lane]]
#define Y(lane, values) values[3 * p[lane] + 1]
#define Z(lane, values) values[3 * p[lane] + 2]
#define PLANES(values) ((reals)EACH_LANE(PLANE, values))
#define TRIPLE(values) {(reals)EACH_LANE(X, values), (reals)EACH_LANE(Y, values), (reals)EACH_LANE(Z, values)}

// Where the pixels dx, dy from those of `at` are; one outside the image is the pixel itself.
static inline void places(const Pixels *at, int dx, int dy, long *p)
{
  const int width = at->view->width, row = at->y + dy;
  for (int lane = 0; lane < LANES; ++lane) {
    const int x = least(at->x + lane, width - 1), column = x + dx;
    const int outside = (column < 0) | (column >= width) | (row < 0) | (row >= at->view->height);
    p[lane] = outside ? (long)at->y * width + x : (long)row * width + column;
  }
}

static inline Surface surface_at(const Pixels *at)
{
  const GBuffer g = at->from;
  long p[LANES];
  places(at, 0, 0, p);
  reals columns;
  for (int lane = 0; lane < LANES; ++lane) ((real *)&columns)[lane] = (real)(at->x + lane);
#if RESOLVED
  const reals3 zero = {R(0.0), R(0.0), R(0.0)};
  const reals3 ray = {ray_x(at->view, columns), ray_y(at->view, (reals)(real)at->y), R(1.0)};
  const reals3 positions = TRIPLE(g.position), normals = TRIPLE(g.normal), albedos = TRIPLE(g.albedo);
  Surface s;
  s.covered = MASK(PLANES(g.weight) > R(0.0));
  s.position = select3(zero, positions, s.covered);
  s.normal = select3(zero, normals, s.covered);
  s.albedo = select3(zero, albedos, s.covered);
  s.to_eye = toward_eye(ray, s.covered);
  return s;
#else
  const reals3 colors = TRIPLE(g.color_sum), normals = TRIPLE(g.normal_sum);
  return resolve_surface(at->view, columns, (reals)(real)at->y, PLANES(g.depth), PLANES(g.weight_sum), colors, normals,
                         PLANES(g.depth_sum));
#endif
}

// Eye z from what the images hold of it: `depth`, where a disc was hit, else the mean of `depth_sum` (sums alone).
static inline reals depth_of(reals depth, reals weights, reals depth_sums)
{
#if !RESOLVED
  const masks unhit = MASK(depth == (real)INFINITY);  // only the pre-filter landed, or nothing
  if (ANY(unhit)) depth = SELECT(depth, divide(depth_sums, weights), unhit);
#endif
  return SELECT((real)INFINITY, depth, MASK(weights > R(0.0)));
}

// Eye z of the surface at the neighbours dx, dy, +inf where nothing is.
static inline reals depths_at(const Pixels *at, int dx, int dy)
{
  const GBuffer g = at->from;
  const int x = at->x + dx, y = at->y + dy, width = at->view->width;
#if !RESOLVED
  if ((x >= 0) & (x + LANES <= width) & (at->x + LANES <= width) & (y >= 0) & (y < at->view->height)) {
    const long first = (long)y * width + x;  // numbers side by side
#define NEXT(lane, values) values[first + lane]
    return depth_of((reals)EACH_LANE(NEXT, g.depth), (reals)EACH_LANE(NEXT, g.weight_sum),
                    (reals)EACH_LANE(NEXT, g.depth_sum));
#undef NEXT
  }
#endif
  long p[LANES];
  places(at, dx, dy, p);
#if RESOLVED
  return depth_of((reals)EACH_LANE(Z, g.position), PLANES(g.weight), R(0.0));
#else
  return depth_of(PLANES(g.depth), PLANES(g.weight_sum), PLANES(g.depth_sum));
#endif
}

// Their normals, 0 where nothing is.
static inline reals3 normals_at(const Pixels *at, int dx, int dy)
{
  const GBuffer g = at->from;
  const reals3 zero = {R(0.0), R(0.0), R(0.0)};
  long p[LANES];
  places(at, dx, dy, p);
#if RESOLVED
  const reals3 normals = TRIPLE(g.normal);
  return select3(zero, normals, MASK(PLANES(g.weight) > R(0.0)));
#else
  const reals3 sums = TRIPLE(g.normal_sum);
  return select3(zero, normalize3(sums), MASK(PLANES(g.weight_sum) > R(0.0)));
#endif
}
