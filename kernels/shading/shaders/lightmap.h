// Provides the shader lightmap: Phong with the light map (passes/lightmap.cl) in place of the lights.
//
// One lookup by the normal gives the diffuse light, one by the mirrored view direction the specular light.
//
// LIGHTMAP  samples of the light map each way

#include "arithmetic/reals.h"
#include "arithmetic/vectors.h"
#include "arithmetic/lanes.h"
#include "shading/surface.h"
#include "shading/octahedral.h"

static inline reals mixed_four(global const real *table, const masks *at, reals f, reals g)
{
#define SAMPLE(lane, offset) table[6 * WHOLE_OF(*at, lane) + offset]
  const reals a = (reals)EACH_LANE(SAMPLE, 0), b = (reals)EACH_LANE(SAMPLE, 6);
  const reals c = (reals)EACH_LANE(SAMPLE, 6 * LIGHTMAP), d = (reals)EACH_LANE(SAMPLE, 6 * LIGHTMAP + 6);
#undef SAMPLE
  const reals upper = a + f * (b - a), lower = c + f * (d - c);
  return upper + g * (lower - upper);
}

static inline reals3 looked_up(global const real *table, reals3 direction)
{
  reals column, row;
  place_of(direction, &column, &row);
  const reals end = (reals)(real)(LIGHTMAP - 2);
  const reals left = at_least(at_most(round_down(column), end), R(0.0));
  const reals top = at_least(at_most(round_down(row), end), R(0.0));
  const reals f = column - left, g = row - top;
  const masks at = whole_of(top * (real)LIGHTMAP + left);
  return (reals3){mixed_four(table, &at, f, g), mixed_four(table + 1, &at, f, g), mixed_four(table + 2, &at, f, g)};
}

static inline reals3 shade_surface(const surfaces *s, constant Shading *shading, constant PhongLight *lights)
{
  const reals3 ambient = scale3(s->albedo, shading->ambient);
  const reals n_v = dot3(s->normal, s->to_eye);
  const reals3 mirrored = add3(scale3(s->normal, R(2.0) * n_v), scale3(s->to_eye, R(-1.0)));
  const reals3 light = scale3(looked_up(s->lightmap, s->normal), shading->diffuse);
  const reals3 diffuse = {light.x * s->albedo.x, light.y * s->albedo.y, light.z * s->albedo.z};
  const reals3 specular = scale3(looked_up(s->lightmap + 3, mirrored), s->specular);
  const masks has_normal = MASK(dot3(s->normal, s->normal) > R(0.0));
  return select3(ambient, add3(add3(ambient, diffuse), specular), has_normal);
}
