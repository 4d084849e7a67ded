// Provides the surface at LANES pixels, in eye space, and its computation from the accumulated sums.
//
// SHADOWS   1: lights may have shadow maps, 0: not
// LIGHTMAP  samples of the light map each way, 0: no light map

#include "arithmetic/reals.h"
#include "arithmetic/divide.h"
#include "arithmetic/vectors.h"
#include "splat/ray.h"

typedef struct {
  reals3 position, normal, albedo;
  reals3 to_eye;  // unit
  reals specular, shininess;
  reals mean_depth, distance;
  masks covered;
#if SHADOWS
  constant ShadowMap *maps;  // of light.h
  global const real *map_depths;
#elif LIGHTMAP
  global const real *lightmap;  // of shaders/lightmap.h
#endif
} surfaces;

// The last arguments of a kernel that shades, and their assignment to its surface.
#if SHADOWS
#define LIGHT_ARGUMENTS , constant ShadowMap *maps, global const real *map_depths
#define TAKE_LIGHT_ARGUMENTS(s) (s).maps = maps, (s).map_depths = map_depths
#elif LIGHTMAP
#define LIGHT_ARGUMENTS , global const real *lightmap
#define TAKE_LIGHT_ARGUMENTS(s) (s).lightmap = lightmap
#else
#define LIGHT_ARGUMENTS
#define TAKE_LIGHT_ARGUMENTS(s)
#endif

static inline reals3 select3(reals3 no, reals3 yes, masks mask)
{
  return (reals3){SELECT(no.x, yes.x, mask), SELECT(no.y, yes.y, mask), SELECT(no.z, yes.z, mask)};
}

// The unit vector from points on the rays d to the eye.
static inline reals3 toward_eye(reals3 d, masks covered)
{
  reals3 to_eye;
  to_eye.x = to_eye.y = R(0.0);  // member by member: rusticl copies such a constant wrongly
  to_eye.z = R(-1.0);
#if !ORTHOGRAPHIC
  to_eye = select3(to_eye, normalize3(scale3(d, R(-1.0))), covered);
#endif
  return to_eye;
}

static inline surfaces resolve_surface(constant View *view, reals x, reals y, reals depth, reals weight_sum,
                                       reals3 color_sum, reals3 normal_sum, reals depth_sum)
{
  const reals3 zero = {R(0.0), R(0.0), R(0.0)};
  const reals3 d = {ray_x(view, x), ray_y(view, y), R(1.0)};
  surfaces s;
  s.covered = MASK(weight_sum > R(0.0));
  s.mean_depth = SELECT((real)INFINITY, divide(depth_sum, weight_sum), s.covered);
  const reals z = SELECT(s.mean_depth, depth, MASK(depth < (real)INFINITY));  // +inf: the pre-filter's pixel
  s.distance = ORTHOGRAPHIC ? z : square_root(dot3(d, d)) * z;
  s.position = ray_point(d, z);
  s.to_eye = toward_eye(d, s.covered);
  const reals3 albedo = {divide(color_sum.x, weight_sum), divide(color_sum.y, weight_sum),
                         divide(color_sum.z, weight_sum)};
  s.position = select3(zero, s.position, s.covered);
  s.albedo = select3(zero, albedo, s.covered);
  s.normal = select3(zero, normalize3(normal_sum), s.covered);
  return s;
}
