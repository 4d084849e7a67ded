// Shading pass: once per pixel, from the resolved G-buffer. SHADER names the header with shade_surface().

#include "arithmetic.h"
#include "surface.h"
#include SHADER

#define GBUFFER                                                                                              \
  global const real *depth, global const real *weight_sum, global const real *color_sum,                     \
      global const real *normal_sum, global const real *depth_sum

static inline Surface surface_at(constant View *view, int x, int y, long p, GBUFFER)
{
  return resolve_surface(view, x, y, depth[p], weight_sum[p],
                         (reals3){color_sum[3 * p], color_sum[3 * p + 1], color_sum[3 * p + 2]},
                         (reals3){normal_sum[3 * p], normal_sum[3 * p + 1], normal_sum[3 * p + 2]}, depth_sum[p]);
}

static inline void store3(global real *out, long p, reals3 v)
{
  out[3 * p] = v.x;
  out[3 * p + 1] = v.y;
  out[3 * p + 2] = v.z;
}

kernel void shade(constant View *view, constant Shading *shading, constant PhongLight *lights, GBUFFER,
                  global real *color)
{
  const int x = get_global_id(0), y = get_global_id(1);
  const long p = (long)y * view->width + x;
  const Surface s = surface_at(view, x, y, p, depth, weight_sum, color_sum, normal_sum, depth_sum);
  const reals3 rgb = s.covered ? shade_surface(&s, shading, lights) : (reals3){0, 0, 0};
  color[4 * p] = rgb.x;
  color[4 * p + 1] = rgb.y;
  color[4 * p + 2] = rgb.z;
  color[4 * p + 3] = s.covered ? R(1.0) : R(0.0);
}

kernel void resolve(constant View *view, GBUFFER, global real *position, global real *normal, global real *albedo,
                    global real *mean_depth, global real *distance)
{
  const int x = get_global_id(0), y = get_global_id(1);
  const long p = (long)y * view->width + x;
  const Surface s = surface_at(view, x, y, p, depth, weight_sum, color_sum, normal_sum, depth_sum);
  store3(position, p, s.position);
  store3(normal, p, s.normal);
  store3(albedo, p, s.albedo);
  mean_depth[p] = s.mean_depth;
  distance[p] = s.distance;
}
