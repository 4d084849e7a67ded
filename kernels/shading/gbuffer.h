// Provides the images that shading reads, LANES pixels of a row at a time.
//
// RESOLVED  0: the sums of the attribute pass; 1: the AOVs P, N and albedo of any origin, and a weight above 0 where
//           there is a surface. Both give the same bits.

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

// LANES pixels of a row and their images. Lanes beyond the end of the row repeat its last pixel.
typedef struct {
  GBuffer from;
  constant View *view;
  int x, y;
} Pixels;

#define VALUE_AT(lane, values) values[p[lane]]
#define X_AT(lane, values) values[3 * p[lane]]
#define Y_AT(lane, values) values[3 * p[lane] + 1]
#define Z_AT(lane, values) values[3 * p[lane] + 2]
#define VALUES_AT(values) ((reals)EACH_LANE(VALUE_AT, values))
#define TRIPLES_AT(values)                                                                                    \
  {(reals)EACH_LANE(X_AT, values), (reals)EACH_LANE(Y_AT, values), (reals)EACH_LANE(Z_AT, values)}

// The indices of the pixels at offset (dx, dy); outside the image, the index of the pixel itself.
static inline void pixel_indices(const Pixels *at, int dx, int dy, long *p)
{
  const int width = at->view->width, row = at->y + dy;
  for (int lane = 0; lane < LANES; ++lane) {
    const int x = least(at->x + lane, width - 1), column = x + dx;
    const int outside = (column < 0) | (column >= width) | (row < 0) | (row >= at->view->height);
    p[lane] = outside ? (long)at->y * width + x : (long)row * width + column;
  }
}

static inline surfaces surface_at(const Pixels *at)
{
  const GBuffer g = at->from;
  long p[LANES];
  pixel_indices(at, 0, 0, p);
  reals columns;
  for (int lane = 0; lane < LANES; ++lane) ((real *)&columns)[lane] = (real)(at->x + lane);
#if RESOLVED
  const reals3 zero = {R(0.0), R(0.0), R(0.0)};
  const reals3 ray = {ray_x(at->view, columns), ray_y(at->view, (reals)(real)at->y), R(1.0)};
  const reals3 positions = TRIPLES_AT(g.position), normals = TRIPLES_AT(g.normal), albedos = TRIPLES_AT(g.albedo);
  surfaces s;
  s.covered = MASK(VALUES_AT(g.weight) > R(0.0));
  s.position = select3(zero, positions, s.covered);
  s.normal = select3(zero, normals, s.covered);
  s.albedo = select3(zero, albedos, s.covered);
  s.to_eye = toward_eye(ray, s.covered);
  return s;
#else
  const reals3 colors = TRIPLES_AT(g.color_sum), normals = TRIPLES_AT(g.normal_sum);
  return resolve_surface(at->view, columns, (reals)(real)at->y, VALUES_AT(g.depth), VALUES_AT(g.weight_sum), colors,
                         normals, VALUES_AT(g.depth_sum));
#endif
}

// Eye z of the surface: `depth` where a disc was hit, otherwise (sums only) the mean depth; +inf where there is none.
static inline reals depth_of(reals depth, reals weights, reals depth_sums)
{
#if !RESOLVED
  const masks unhit = MASK(depth == (real)INFINITY);  // only the pre-filter, or nothing, covers the pixel
  if (ANY(unhit)) depth = SELECT(depth, divide(depth_sums, weights), unhit);
#endif
  return SELECT((real)INFINITY, depth, MASK(weights > R(0.0)));
}

// Eye z of the surface at the neighbors at offset (dx, dy), +inf where there is none.
static inline reals depths_at(const Pixels *at, int dx, int dy)
{
  const GBuffer g = at->from;
  const int x = at->x + dx, y = at->y + dy, width = at->view->width;
#if !RESOLVED
  if ((x >= 0) & (x + LANES <= width) & (at->x + LANES <= width) & (y >= 0) & (y < at->view->height)) {
    const long first = (long)y * width + x;  // consecutive reals: one vector load
#define NEXT(lane, values) values[first + lane]
    return depth_of((reals)EACH_LANE(NEXT, g.depth), (reals)EACH_LANE(NEXT, g.weight_sum),
                    (reals)EACH_LANE(NEXT, g.depth_sum));
#undef NEXT
  }
#endif
  long p[LANES];
  pixel_indices(at, dx, dy, p);
#if RESOLVED
  return depth_of((reals)EACH_LANE(Z_AT, g.position), VALUES_AT(g.weight), R(0.0));
#else
  return depth_of(VALUES_AT(g.depth), VALUES_AT(g.weight_sum), VALUES_AT(g.depth_sum));
#endif
}

// The normals at these neighbors, 0 where there is no surface.
static inline reals3 normals_at(const Pixels *at, int dx, int dy)
{
  const GBuffer g = at->from;
  const reals3 zero = {R(0.0), R(0.0), R(0.0)};
  long p[LANES];
  pixel_indices(at, dx, dy, p);
#if RESOLVED
  const reals3 normals = TRIPLES_AT(g.normal);
  return select3(zero, normals, MASK(VALUES_AT(g.weight) > R(0.0)));
#else
  const reals3 sums = TRIPLES_AT(g.normal_sum);
  return select3(zero, normalize3(sums), MASK(VALUES_AT(g.weight_sum) > R(0.0)));
#endif
}
