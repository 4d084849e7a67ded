// The margin: the least distance of a pixel's decisions from flipping, in units of each decision's own rounding error.
//
// A work-item takes one region of a tile and streams the tile's records twice: for the front-most splat, then for all
// decisions. A comparison without division shows most decisions to be far from flipping.
//
// STRICT_EPSILON  as in splat/fragment.h

#include "arithmetic/reals.h"
#include "arithmetic/divide.h"
#include "arithmetic/lanes.h"
#include "evidence/margin.h"
#include "evidence/pair.h"

#define ROUNDED_UP R(1.0000000000009095)  // 1 + 2^-40: a product's rounding hides no tie

// The results so far at a region's pixels, block by block.
typedef struct {
  block at[BLOCKS];
  reals depth[BLOCKS], depth_scale[BLOCKS];  // of the front-most splat
  masks front[BLOCKS];                       // its record
  reals units[BLOCKS], raw[BLOCKS];          // the least margin so far, and the distance of its decision
} pixel_margins;

INLINE void keep(pixel_margins *p, int k, reals units, reals distance, masks decided)
{
  const masks less = decided & MASK(units < p->units[k]), tie = decided & MASK(units == p->units[k]);
  p->raw[k] = SELECT(SELECT(p->raw[k], least_of(p->raw[k], distance), tie), distance, less);
  p->units[k] = SELECT(p->units[k], units, less);
}

// The greatest distance / scale at which a decision can have the least margin.
INLINE reals nearest_of(const pixel_margins *p, int k) { return p->units[k] * (UNIT * ROUNDED_UP); }

INLINE void consider(pixel_margins *p, int k, reals distance, reals scale, masks decided)
{
  const masks close = decided & MASK(distance <= nearest_of(p, k) * scale);
  if (ANY(close)) keep(p, k, divide(distance, UNIT * scale), distance, close);
}

// The decision to hit the disc: its conditions must hold together, so the least of their signed margins counts.
INLINE void consider_hit(pixel_margins *p, int k, global const NearbySplat *s, const intersection *m, const scales *e)
{
  if (s->usable < -MAX_MARGIN) return;
  const reals nearest = nearest_of(p, k), own = (reals)s->usable;
  const reals inside = nearest * e->inside, range = nearest * e->z;
  const masks possible = ~MASK(m->inside < -inside) & ~MASK(m->range < -range);
  const masks close = MASK(m->inside <= inside) | MASK(m->range <= range) | MASK(own <= p->units[k]);
  if (!ANY(possible & close)) return;
  const reals units = least_of(least_of(own, divide(m->inside, UNIT * e->inside)), divide(m->range, UNIT * e->z));
  reals r = divide(m->size, magnitude(m->den));
  r = SELECT(r, (reals)R(0.0), MASK(r != r));  // exactly edge-on: 0 / 0
  const reals distance = magnitude(R(1.0) - r);
  keep(p, k, magnitude(units), distance, possible & close & in_bounds(s, &p->at[k]));
}

// The decision of the pre-filter, likewise, where the disc is not hit.
INLINE void consider_screen(pixel_margins *p, int k, global const NearbySplat *s, const screen *f, masks missed)
{
  const reals inside = nearest_of(p, k) * f->scale, own = (reals)s->filter_margin;
  const masks possible = missed & ~MASK(f->inside < -inside);
  const masks close = MASK(f->inside <= inside) | MASK(own <= p->units[k]);
  if (!ANY(possible & close)) return;
  const reals units = least_of(own, divide(f->inside, UNIT * f->scale));
  keep(p, k, magnitude(units), magnitude(R(1.0) - f->r2), possible & close & in_bounds(s, &p->at[k]));
}

INLINE void find_front(constant View *view, global const NearbySplat *s, int i, int k, pixel_margins *p,
                       real offset_error)
{
  if (!ANY(MASK((reals)s->near_z <= p->depth[k]))) return;
  const intersection m = intersection_at(view, s, &p->at[k]);
  const masks closer = is_hit(s, &p->at[k], &m) & MASK(m.z < p->depth[k]);
  if (!ANY(closer)) return;
  const scales e = scales_of(view, s, &p->at[k], &m, offset_error);
  p->depth[k] = SELECT(p->depth[k], m.z, closer);
  p->depth_scale[k] = SELECT(p->depth_scale[k], e.z, closer);
  p->front[k] = (p->front[k] & ~closer) | ((masks)i & closer);
}

INLINE void decide(constant View *view, global const NearbySplat *s, int i, int k, pixel_margins *p, real offset_error,
                   real epsilon, int along_ray)
{
  const block *b = &p->at[k];
  const intersection m = intersection_at(view, s, b);
  const scales e = scales_of(view, s, b, &m, offset_error);
  const masks hit = is_hit(s, b, &m), behind = ~(hit & MASK(p->front[k] == (masks)i));
  masks exists = hit;
  consider_hit(p, k, s, &m, &e);
  if (s->filter_margin >= -MAX_MARGIN) {
    const screen f = screen_at(view, s, b, offset_error);
    consider_screen(p, k, s, &f, ~hit);
    const masks filtered = (masks)(s->filter_margin >= R(0.0) ? -1 : 0);
    exists |= filtered & ~MASK(f.inside < R(0.0));
  }
#if STRICT_EPSILON
  // The front-most splat passes unless epsilon vanishes in depth(p) + epsilon. Epsilon 0 always rejects it.
  const reals offset = epsilon_at(b, epsilon, along_ray);
  consider(p, k, offset, magnitude(p->depth[k]) + offset, ~behind & MASK(offset > R(0.0)));
#endif
  const masks tested = exists & behind & MASK(p->depth[k] < (real)INFINITY);
  if (!ANY(tested)) return;
  const reals z = SELECT((reals)s->center_z, m.z, hit), own_scale = SELECT((reals)magnitude_of(s->center_z), e.z, hit);
  const reals tolerance = epsilon_at(b, epsilon, along_ray), scale = own_scale + p->depth_scale[k];
  consider(p, k, z - p->depth[k], scale, hit & tested);
  consider(p, k, magnitude((p->depth[k] + tolerance) - z), scale + tolerance, tested);
}

// The blocks of a region that a splat's bounds touch, both ends included.
typedef struct {
  int x_first, x_last, y_first, y_last;
} block_range;

INLINE block_range blocks_of(global const NearbySplat *s, const pair_region *w)
{
  block_range r = {max((int)s->x_first - w->x, 0) / BLOCK_X, min((int)s->x_last - w->x, REGION - 1) / BLOCK_X,
                   max((int)s->y_first - w->y, 0) / BLOCK_Y, min((int)s->y_last - w->y, REGION - 1) / BLOCK_Y};
  return r;
}

kernel void margin(constant View *view, global const NearbySplat *records, global const int *tile_begin,
                   const int first_tile, const int first_entry, const int tiles_x, const real offset_error,
                   const real epsilon, const int along_ray, global float *units, global float *raw)
{
  const pair_region w = pair_region_of(get_global_id(0), tile_begin, first_tile, first_entry, tiles_x);
  pixel_margins p;
  for (int k = 0; k < BLOCKS; ++k) {
    p.at[k] = block_at(view, w.x + k % BLOCKS_X * BLOCK_X, w.y + k / BLOCKS_X * BLOCK_Y);
    p.depth[k] = (reals)INFINITY;
    p.depth_scale[k] = (reals)R(0.0);
    p.front[k] = (masks)-1;
    p.units[k] = (reals)MAX_MARGIN;
    p.raw[k] = (reals)INFINITY;
  }
  for (int i = w.begin; i < w.end; ++i) {
    const block_range r = blocks_of(records + i, &w);
    for (int y = r.y_first; y <= r.y_last; ++y)
      for (int x = r.x_first; x <= r.x_last; ++x)
        find_front(view, records + i, i, y * BLOCKS_X + x, &p, offset_error);
  }
  for (int i = w.begin; i < w.end; ++i) {
    const block_range r = blocks_of(records + i, &w);
    for (int y = r.y_first; y <= r.y_last; ++y)
      for (int x = r.x_first; x <= r.x_last; ++x)
        decide(view, records + i, i, y * BLOCKS_X + x, &p, offset_error, epsilon, along_ray);
  }
  for (int k = 0; k < BLOCKS; ++k)
    for (int lane = 0; lane < LANES; ++lane) {
      const int x = p.at[k].x + lane % BLOCK_X, y = p.at[k].y + lane / BLOCK_X;
      if (x >= view->width || y >= view->height) continue;
      const real least = LANE_OF(p.units[k], lane);
      units[(long)y * view->width + x] = (float)least;
      raw[(long)y * view->width + x] = least < MAX_MARGIN ? (float)LANE_OF(p.raw[k], lane) : (float)INFINITY;
    }
}
