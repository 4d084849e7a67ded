// Provides the direction and color of a light at LANES points of a surface.
//
// SHADOWS  1: lights may have shadow maps (surface.h), 0: not

#include "arithmetic/reals.h"
#include "arithmetic/vectors.h"
#include "shading/surface.h"
#include "shading/shadow.h"

// The unit vector toward the light.
static inline reals3 toward_light(const surfaces *s, constant PhongLight *light)
{
  const reals3 place = {light->x, light->y, light->z};
  return normalize3(light->is_point > R(0.0) ? add3(place, scale3(s->position, R(-1.0))) : place);
}

// The color that arrives: the light's color times its cone's falloff times the share that no splat blocks.
static inline reals3 light_tint(const surfaces *s, constant PhongLight *light, reals3 toward)
{
  reals3 tint = {light->red, light->green, light->blue};
  if (light->cone > R(0.0)) {
    const reals3 back = {light->back_x, light->back_y, light->back_z};
    const reals within = (dot3(toward, back) - light->cos_outer) * light->cone;
    tint = scale3(tint, at_least(at_most(within, R(1.0)), R(0.0)));
  }
#if SHADOWS
  if (light->map >= 0) tint = scale3(tint, lit_share(s->maps + light->map, s->map_depths, s->position));
#endif
  return tint;
}

typedef struct {
  reals3 toward;  // unit
  reals3 color;
} Arriving;

static inline Arriving arriving(const surfaces *s, constant PhongLight *light)
{
  Arriving a;
  a.toward = toward_light(s, light);
  a.color = light_tint(s, light, a.toward);
  return a;
}
