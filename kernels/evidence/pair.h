// Provides the oracle's equations for pairs of one nearby splat and LANES pixels, and the scales of their rounding
// errors.
//
// TILE          side of a tile, pixels
// REGION        side of the region of a work-item, pixels: the whole tile, or one pixel
// ORTHOGRAPHIC  1: the projection is orthographic, 0: perspective

#include "arithmetic/reals.h"
#include "arithmetic/divide.h"
#include "arithmetic/lanes.h"
#include "evidence/margin.h"

#define BLOCKS_X (REGION / BLOCK_X)
#define BLOCKS_Y (REGION / BLOCK_Y)
#define BLOCKS (BLOCKS_X * BLOCKS_Y)
#define PAIR_REGIONS_X (TILE / REGION)  // of one tile
#define PAIR_REGIONS (PAIR_REGIONS_X * PAIR_REGIONS_X)

// The region of a work-item: its records [begin, end) and its first pixel.
typedef struct {
  int begin, end, x, y;
} pair_region;

// tile_begin counts from the band's first tile, records from the entry `first_entry`.
INLINE pair_region pair_region_of(int item, global const int *tile_begin, int first_tile, int first_entry, int tiles_x)
{
  const int run = item / PAIR_REGIONS, part = item % PAIR_REGIONS, tile = first_tile + run;
  pair_region w = {tile_begin[run] - first_entry, tile_begin[run + 1] - first_entry,
              tile % tiles_x * TILE + part % PAIR_REGIONS_X * REGION,
                   tile / tiles_x * TILE + part / PAIR_REGIONS_X * REGION};
  return w;
}

// A block of pixels: its first pixel, and all pixels' rays s = ((x-cx)/fx, (y-cy)/fy, 1).
typedef struct {
  int x, y;
  reals p_x, p_y, s_x, s_y;
} block;

INLINE block block_at(constant View *view, int x, int y)
{
  block b = {x, y, (real)x + LANE_X, (real)y + LANE_Y};
  b.s_x = divide((b.p_x - view->cx_hi) - view->cx_lo, (reals)view->fx_hi);
  b.s_y = divide((b.p_y - view->cy_hi) - view->cy_lo, (reals)view->fy_hi);
  return b;
}

// Epsilon along z at each pixel. An epsilon along a perspective ray is shorter along z.
INLINE reals epsilon_at(const block *b, real epsilon, int along_ray)
{
  if (ORTHOGRAPHIC || !along_ray) return (reals)epsilon;
  return divide((reals)epsilon, square_root((b->s_x * b->s_x + b->s_y * b->s_y) + R(1.0)));
}

// A pair lies within the splat's widened bounds, so pairs do not depend on the blocks of their pixels.
INLINE masks in_bounds(global const NearbySplat *s, const block *b)
{
  return MASK(b->p_x >= s->x_first) & MASK(b->p_x <= s->x_last) & MASK(b->p_y >= s->y_first) &
         MASK(b->p_y <= s->y_last);
}

// A hit needs inside >= 0, range >= 0 and the splat's usable >= 0. NaN is unknown and does not exclude a hit.
typedef struct {
  reals size, den, inverse;  // r3 = size / |den|, inverse = 1 / den
  reals inside;              // den - size
  reals z, range;            // z of the plane; its distance from the ends of [near, far]
} intersection;

INLINE intersection intersection_at(constant View *view, global const NearbySplat *s, const block *b)
{
  intersection m;
  const reals u = (b->s_x * s->u_x + b->s_y * s->u_y) + s->u_1;
  const reals v = (b->s_x * s->v_x + b->s_y * s->v_y) + s->v_1;
  const reals g = (b->s_x * s->g_x + b->s_y * s->g_y) + s->g_1;
  m.size = square_root(u * u + v * v);
  m.den = ORTHOGRAPHIC ? (reals)s->h : g;
  m.inside = m.den - m.size;
  m.inverse = divide((reals)R(1.0), m.den);
  m.z = (ORTHOGRAPHIC ? g : (reals)s->h) * m.inverse;
  m.range = least_of(m.z - view->near, view->far - m.z);
  return m;
}

INLINE masks is_hit(global const NearbySplat *s, const block *b, const intersection *m)
{
  const masks usable = (masks)(s->usable >= R(0.0) ? -1 : 0);
  return usable & ~MASK(m->inside < R(0.0)) & ~MASK(m->range < R(0.0));
}

// The rounding errors of an intersection in units of 2^-24; `offset_error` is a projected center's, in 2^-24 pixels.
typedef struct {
  reals inside, z;
} scales;

INLINE scales scales_of(constant View *view, global const NearbySplat *s, const block *b, const intersection *m,
                        real offset_error)
{
  const reals e_x = magnitude(b->s_x - s->center_x) + divide_real(offset_error, view->fx_hi);
  const reals e_y = magnitude(b->s_y - s->center_y) + divide_real(offset_error, view->fy_hi);
  const real g_x = magnitude_of(s->g_x), g_y = magnitude_of(s->g_y);
  const reals slope = s->steep * (g_x * e_x + g_y * e_y);
  const real u_v_x = magnitude_of(s->u_x) + magnitude_of(s->v_x), u_v_y = magnitude_of(s->u_y) + magnitude_of(s->v_y);
  scales e;
#if ORTHOGRAPHIC
  e.inside = (u_v_x * e_x + u_v_y * e_y) + s->steep * s->den;
  e.z = (magnitude(m->z) * s->den + slope) * magnitude(m->inverse) + TINY;
#else
  e.inside = ((u_v_x + g_x) * e_x + (u_v_y + g_y) * e_y) + s->steep * s->den;
  e.z = magnitude(m->z) * (s->den + slope) * magnitude(m->inverse) + TINY;
#endif
  return e;
}

// The pre-filter: a pixel is inside if r2 <= 1 and the splat's filter_margin >= 0.
typedef struct {
  reals r2, scale_r2;   // rounding errors in units of 2^-24
  reals inside, scale;  // 1 - r2^2
} screen;

INLINE screen screen_at(constant View *view, global const NearbySplat *s, const block *b, real least_error)
{
  const reals x = b->p_x - s->filter_x, y = b->p_y - s->filter_y;
  const real radius = view->prefilter_radius, error = s->filter_error > least_error ? s->filter_error : least_error;
  const reals squared = (x * x + y * y) * divide_real(R(1.0), radius * radius), r2 = square_root(squared);
  const real relative = divide_real(error, radius);
  screen f = {r2, r2 + R(2.0) * relative, R(1.0) - squared, R(2.0) * squared + (R(4.0) * relative) * r2};
  return f;
}
