// Provides the lookup in shadow maps, images of the depth that a light sees.
//
// SHADOWS  1: there are shadow maps; 0: the header is empty

#include "arithmetic/reals.h"
#include "arithmetic/divide.h"
#include "arithmetic/vectors.h"
#include "arithmetic/lanes.h"

#if SHADOWS
// 1 where the light reaches depth z at the map's texels (x, y), whole numbers, else 0; beyond the map always 1.
static inline reals lit_at(constant ShadowMap *map, global const real *depths, reals x, reals y, reals z)
{
  const real last = (real)(map->size - 1);
  const masks inside = MASK(x >= R(0.0)) & MASK(x <= last) & MASK(y >= R(0.0)) & MASK(y <= last);
  const masks column = whole_of(SELECT(R(0.0), x, inside)), row = whole_of(SELECT(R(0.0), y, inside));
#define TEXEL(lane, depths) depths[map->first + WHOLE_OF(row, lane) * map->size + WHOLE_OF(column, lane)]
  const reals nearest = (reals)EACH_LANE(TEXEL, depths);
#undef TEXEL
  return SELECT(R(1.0), SELECT(R(0.0), R(1.0), MASK(z <= nearest + map->bias)), inside);
}

static inline reals mixed(reals a, reals b, reals share) { return a + share * (b - a); }

// The share of the light that reaches points in eye space: the value of their texel or, `filtered`, the bilinear mean
// of the four texels with centers around them (percentage-closer filtering).
static inline reals lit_share(constant ShadowMap *map, global const real *depths, reals3 p)
{
  const reals z = ((map->r20 * p.x + map->r21 * p.y) + map->r22 * p.z) + map->t2;
  const reals focal = map->perspective ? divide((reals)map->focal, z) : (reals)map->focal;
  reals x = (((map->r00 * p.x + map->r01 * p.y) + map->r02 * p.z) + map->t0) * focal + map->middle;
  reals y = (((map->r10 * p.x + map->r11 * p.y) + map->r12 * p.z) + map->t1) * focal + map->middle;
  const real shift = map->filtered ? R(0.5) : R(0.0), end = (real)map->size;
  x = SELECT(R(-1.0), at_least(at_most(x - shift, end), R(-1.0)), MASK(z >= map->near));
  y = at_least(at_most(y - shift, end), R(-1.0));
  const reals column = round_down(x), row = round_down(y);
  if (!map->filtered) return lit_at(map, depths, column, row, z);
  const reals f = x - column, g = y - row, one = (reals)R(1.0);
  const reals upper = mixed(lit_at(map, depths, column, row, z), lit_at(map, depths, column + one, row, z), f);
  const reals lower =
      mixed(lit_at(map, depths, column, row + one, z), lit_at(map, depths, column + one, row + one, z), f);
  return mixed(upper, lower, g);
}
#endif
