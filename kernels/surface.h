// Resolve: what the accumulated sums say of the surface at one pixel, in eye space. Needs arithmetic.h, LANES 1.

#include "ray.h"

typedef struct {
  reals3 position, normal, albedo;
  reals3 to_eye;  // unit
  real mean_depth, distance;
  int covered;
} Surface;

static inline reals3 normalize3(reals3 v)
{
  const real length2 = dot3(v, v);
  return length2 > R(0.0) ? scale3(v, divide(R(1.0), square_root(length2))) : (reals3){0, 0, 0};
}

static inline Surface resolve_surface(constant View *view, int x, int y, real depth, real weight_sum, reals3 color_sum,
                                      reals3 normal_sum, real depth_sum)
{
  Surface s = {{0, 0, 0}, {0, 0, 0}, {0, 0, 0}, {0, 0, R(-1.0)}, (real)INFINITY, (real)INFINITY, weight_sum > R(0.0)};
  if (s.covered) s.mean_depth = divide(depth_sum, weight_sum);
  const real z = depth < (real)INFINITY ? depth : s.mean_depth;  // no disc was hit, only the pre-filter landed
  const reals3 d = {ray_x(view, x), ray_y(view, y), R(1.0)};
  s.distance = ORTHOGRAPHIC ? z : square_root(dot3(d, d)) * z;
  if (!s.covered) return s;
#if ORTHOGRAPHIC
  s.position = (reals3){d.x, d.y, z};
#else
  s.position = scale3(d, z);
  s.to_eye = normalize3(scale3(d, R(-1.0)));
#endif
  s.albedo = (reals3){divide(color_sum.x, weight_sum), divide(color_sum.y, weight_sum),
                      divide(color_sum.z, weight_sum)};
  s.normal = normalize3(normal_sum);
  return s;
}
