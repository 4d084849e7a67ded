// The envelope: the bounds of each pixel's values over all correct renderers.
//
// A work-item takes a tile, block by block. It lists the splats that touch the block, bounds the depth, bounds the
// weight of each possible fragment, and finds the extremes of the weighted means.
//
// VALUES          numbers of each splat: its color, its normal and the margin of the normal's sign
// STRICT_EPSILON  as in splat/fragment.h

#include "arithmetic/reals.h"
#include "arithmetic/lanes.h"
#include "splat/weight.h"
#include "evidence/margin.h"
#include "evidence/pair.h"
#include "evidence/means.h"

// Whether decisions hold in every correct renderer (sure), or in some (possible).
typedef struct {
  masks sure, possible;
} outcome;

INLINE outcome decided(reals inside, reals error) { return (outcome){~MASK(inside <= error), ~MASK(inside <= -error)}; }

INLINE outcome both(outcome a, outcome b) { return (outcome){a.sure & b.sure, a.possible & b.possible}; }

// The outcome `a` together with the splat's own margin. An uncertain pair must lie in the widened bounds.
INLINE outcome together(const envelope_settings *f, global const NearbySplat *s, const block *b, real own, outcome a)
{
  a.sure &= (masks)(own > f->tolerance ? -1 : 0);
  a.possible &= (masks)(own > -f->tolerance ? -1 : 0);
  if (ANY(a.possible & ~a.sure)) a.possible &= in_bounds(s, b);
  return a;
}

// The hit of a disc: z is within low..high, r3 within r_error of r.
typedef struct {
  outcome hit;
  reals low, high, r, r_error;
} disc_outcome;

INLINE disc_outcome disc_at(const envelope_settings *f, global const NearbySplat *s, const block *b)
{
  const intersection m = intersection_at(f->view, s, b);
  const scales e = scales_of(f->view, s, b, &m, f->offset_error);
  const reals error = f->unit * e.z, inverse = magnitude(m.inverse);
  const outcome met = both(decided(m.inside, f->unit * e.inside), decided(m.range, error));
  disc_outcome d = {together(f, s, b, s->usable, met),
            m.z - error, m.z + error, m.size * inverse, f->unit * (e.inside * inverse)};
  return d;
}

// The pre-filter: r2 is within r_error of r.
typedef struct {
  outcome inside;
  reals r, r_error;
} filter_outcome;

INLINE filter_outcome filter_at(const envelope_settings *f, global const NearbySplat *s, const block *b)
{
#if PREFILTER
  const screen p = screen_at(f->view, s, b, f->offset_error);
  filter_outcome g = {together(f, s, b, s->filter_margin, decided(p.inside, f->unit * p.scale)), p.r2,
                      f->unit * p.scale_r2};
#else
  filter_outcome g = {{(masks)0, (masks)0}, (reals)R(0.0), (reals)R(0.0)};
#endif
  return g;
}

// List the splats that touch the block, in splat order; return their number.
INLINE int list_splats(const scratch *t, int num_records, const block *b)
{
  int n = 0;
  for (int i = 0; i < num_records; ++i) {
    const short4 s = t->bounds[i];
    t->list[n] = i;
    n += (s.x < b->x + BLOCK_X) & (s.z >= b->x) & (s.y < b->y + BLOCK_Y) & (s.w >= b->y);
  }
  return n;
}

// The least possible depth, the least without the nearest splat, and the greatest possible depth.
typedef struct {
  reals least, second, greatest;
} depths;

INLINE depths bound_depth(const envelope_settings *f, const scratch *t, int n, const block *b)
{
  depths d = {INFINITE, INFINITE, INFINITE};
  for (int i = 0; i < n; ++i) {
    global const NearbySplat *s = t->records + t->list[i];
    if (!ANY(MASK((reals)s->near_z <= d.greatest))) continue;  // it cannot be front-most: nothing changes
    const disc_outcome a = disc_at(f, s, b);
    const reals low = SELECT(INFINITE, a.low, a.hit.possible);
    d.second = least_of(d.second, most_of(d.least, low));
    d.least = least_of(d.least, low);
    d.greatest = least_of(d.greatest, SELECT(INFINITE, a.high, a.hit.sure));
  }
  return d;
}

// The least and greatest weight of a fragment, if it exists.
typedef struct {
  reals low, high;
} weight_range;

#if KERNEL == TABLE_NEAREST || KERNEL == TABLE_LINEAR
// A table need not be monotonic: the weights of all samples between the radii count as well.
INLINE weight_range weights_between(const envelope_settings *f, reals r_low, reals r_high)
{
  const reals a = weight_of(r_low * r_low, f->falloff, f->table, f->table_size);
  const reals b = weight_of(r_high * r_high, f->falloff, f->table, f->table_size);
  weight_range w = {least_of(a, b), most_of(a, b)};
  const reals first = table_place(r_low * r_low, f->table_size), end = table_place(r_high * r_high, f->table_size);
  const real rounding = KERNEL == TABLE_NEAREST ? R(0.5) : R(0.0);
  for (int lane = 0; lane < LANES; ++lane) {
    const real low = LANE_OF(first, lane) - rounding;
    const int last = (int)(LANE_OF(end, lane) + rounding);
    for (int k = low > R(0.0) ? (int)low + ((real)(int)low < low) : 0; k <= last; ++k) {
      real *least = (real *)&w.low + lane, *most = (real *)&w.high + lane;
      if (f->table[k] < *least) *least = f->table[k];
      if (f->table[k] > *most) *most = f->table[k];
    }
  }
  return w;
}
#else
INLINE weight_range weights_between(const envelope_settings *f, reals r_low, reals r_high)
{
  return (weight_range){weight_of(r_high * r_high, f->falloff, f->table, f->table_size),
                 weight_of(r_low * r_low, f->falloff, f->table, f->table_size)};
}
#endif

INLINE reals within_rim(reals r) { return at_most(at_least(r, R(0.0)), R(1.0)); }

INLINE weight_range weights_of(const envelope_settings *f, const disc_outcome *d, const filter_outcome *g)
{
  const reals rim = (reals)R(1.0);
  const reals low = least_of(SELECT(rim, d->r - d->r_error, d->hit.possible),
                             SELECT(rim, g->r - g->r_error, g->inside.possible));
  const reals high = least_of(SELECT(rim, d->r + d->r_error, d->hit.sure),
                              SELECT(rim, g->r + g->r_error, g->inside.sure));
  const weight_range w = weights_between(f, within_rim(low), within_rim(high));
  const real rounding = f->unit * (R(1.0) - f->falloff);  // falloff = -cutoff^2 / 2
  return (weight_range){w.low * (R(1.0) - rounding), w.high * (R(1.0) + rounding)};
}

// Keep the extremes of the values of fragment i. A normal may have either sign if its splat's facing is uncertain.
INLINE void keep_extremes(const envelope_settings *f, const scratch *t, int record, int i)
{
  global const real *value = t->values + (long)VALUES * record;
  global real *extreme = t->extremes + 2 * MEANS * i;
  const int open = magnitude_of(value[MEANS]) <= f->tolerance;
  for (int k = 0; k < MEANS; ++k) {
    const real size = magnitude_of(value[k]);
    extreme[2 * k] = open && k >= NORMAL ? -size : value[k];
    extreme[2 * k + 1] = open && k >= NORMAL ? size : value[k];
  }
}

#if STRICT_EPSILON
#define BEFORE(z, limit) MASK((z) < (limit))
#else
#define BEFORE(z, limit) MASK((z) <= (limit))
#endif

// Keep the possible fragments with the bounds of their weights, 0 at pixels without the fragment.
INLINE weight_sums collect_fragments(const envelope_settings *f, const scratch *t, int n, const block *b,
                                     const depths *d)
{
  weight_sums c = {R(0.0), R(0.0), R(0.0), INFINITE, 0};
  const reals epsilon = epsilon_at(b, f->epsilon, f->along_ray), slack = R(2.0) * f->unit * epsilon;
  const reals sure_limit = d->least + epsilon - slack, possible_limit = d->greatest + epsilon + slack;
  masks front_passes = (masks)-1, hits_pass = (masks)-1;
#if STRICT_EPSILON  // the front splat passes unless epsilon vanishes in depth(p) + epsilon; epsilon 0 rejects all hits
  const reals farthest = most_of(magnitude(d->least), magnitude(d->greatest)) + epsilon;
  front_passes = MASK(epsilon - slack > f->unit * farthest);
  hits_pass = MASK(epsilon > R(0.0));
#endif
  for (int i = 0; i < n; ++i) {
    const int record = t->list[i];
    global const NearbySplat *s = t->records + record;
    if (!ANY(MASK((reals)s->near_z <= possible_limit))) continue;
    const disc_outcome a = disc_at(f, s, b);
    const filter_outcome g = filter_at(f, s, b);
    const masks by_center = ~a.hit.sure & g.inside.possible;
    const reals z = (reals)s->center_z, z_error = (reals)(f->unit * magnitude_of(s->center_z));
    const reals hit_low = SELECT(INFINITE, a.low, a.hit.possible);
    const reals low = least_of(SELECT(INFINITE, hit_low, hits_pass), SELECT(INFINITE, z - z_error, by_center));
    masks possible = (a.hit.possible | g.inside.possible) & BEFORE(low, possible_limit);
    if (!ANY(possible)) continue;
    const reals high = most_of(SELECT(-INFINITE, a.high, a.hit.possible), SELECT(-INFINITE, z + z_error, by_center));
    const masks front = a.hit.sure & MASK(hit_low == d->least) & MASK(a.high < d->second) & front_passes;
    const masks sure = ((a.hit.sure | g.inside.sure) & BEFORE(high, sure_limit)) | front;
    const masks may_be_front = a.hit.possible & MASK(hit_low <= d->greatest);
    weight_range w = weights_of(f, &a, &g);
    c.front_weight = least_of(c.front_weight, SELECT(INFINITE, w.low, may_be_front));
    possible &= MASK(w.high > R(0.0));
    w.low = SELECT((reals)R(0.0), w.low, sure);
    w.high = SELECT((reals)R(0.0), w.high, possible);
    c.low += w.low;
    c.high += w.high;
    c.count += SELECT((reals)R(0.0), (reals)R(1.0), possible);
    keep_extremes(f, t, record, c.num);
    t->weights[2 * c.num] = w.low;
    t->weights[2 * c.num + 1] = w.high;
    ++c.num;
  }
  c.front_weight = SELECT((reals)R(0.0), c.front_weight, front_passes);
  return c;
}

// Bound the means. The bounds of a pixel that may be uncovered include 0.
INLINE void bound_means(const scratch *t, const weight_sums *c, const depths *d, reals *low, reals *high)
{
  for (int k = 0; k < MEANS; ++k) bound_mean(t, c, k, low + k, high + k);
  normalize_box(low + NORMAL, high + NORMAL);
  const masks covered = (MASK(d->greatest < INFINITE) & MASK(c->front_weight > R(0.0))) | MASK(c->low > R(0.0));
  for (int k = 0; k < MEANS; ++k) {
    low[k] = SELECT(least_of(low[k], (reals)R(0.0)), low[k], covered);
    high[k] = SELECT(most_of(high[k], (reals)R(0.0)), high[k], covered);
  }
}

#if LANES == 1
typedef float floats;
#define TO_FLOATS(x) ((float)(x))
#define TO_REALS(x) ((real)(x))
#define TO_INTS(x) ((int)(x))
#define AS_INTS(x) as_int(x)
#define AS_FLOATS(x) as_float(x)
#else
typedef PASTE(float, LANES) floats;
#define TO_FLOATS(x) PASTE(convert_float, LANES)(x)
#define TO_REALS(x) PASTE(convert_double, LANES)(x)
#define TO_INTS(x) PASTE(convert_int, LANES)(x)
#define AS_INTS(x) PASTE(as_int, LANES)(x)
#define AS_FLOATS(x) PASTE(as_float, LANES)(x)
#endif

#define BELOW_ZERO (-0x7fffffff)  // from the bits of 0 to those of the greatest negative float

// Round to float toward -infinity: take the next lower float if rounding went up.
INLINE floats rounded_down(reals x)
{
  const floats f = TO_FLOATS(x) + 0.0f;  // no -0
  const reals rounded = TO_REALS(f);
  const masks positive = MASK(rounded > R(0.0)), negative = MASK(rounded < R(0.0)), wrong = MASK(rounded > x);
  const masks next = (positive & (bits)-1) | (negative & (bits)1) | (~positive & ~negative & (bits)BELOW_ZERO);
  return AS_FLOATS(AS_INTS(f) + TO_INTS(wrong & next));
}

// Store the bounds of one channel at the pixels of a block that lie in the image, rounded outward.
INLINE void store_bounds(constant View *view, const block *b, global float *least, global float *most, int channels,
                         int channel, reals low, reals high)
{
  const floats down = rounded_down(low), up = -rounded_down(-high);
  for (int lane = 0; lane < LANES; ++lane) {
    const int x = b->x + lane % BLOCK_X, y = b->y + lane / BLOCK_X;
    if (x >= view->width || y >= view->height) continue;
    const long place = ((long)y * view->width + x) * channels + channel;
    least[place] = ((const float *)&down)[lane];
    most[place] = ((const float *)&up)[lane];
  }
}

kernel void envelope(constant View *view, global const NearbySplat *records, global const short4 *bounds,
                     global const real *values, global const int *tile_begin, const int first_tile,
                     const int first_entry, const int tiles_x, const real tolerance, const real offset_error,
                     const real epsilon, const int along_ray, const real falloff, constant real *table,
                     const int table_size, global int *list, global reals *weights, global real *extremes,
                     global float *z_low, global float *z_high, global float *weight_low, global float *weight_high,
                     global float *albedo_low, global float *albedo_high, global float *normal_low,
                     global float *normal_high)
{
  const pair_region w = pair_region_of(get_global_id(0), tile_begin, first_tile, first_entry, tiles_x);
  const envelope_settings f = {view,    table,   tolerance, tolerance * UNIT, offset_error,
                               epsilon, falloff, along_ray, table_size};
  const scratch t = {records + w.begin, bounds + first_entry + w.begin, values + (long)VALUES * w.begin,
                  list + w.begin, weights + 2 * (long)w.begin, extremes + 2 * MEANS * (long)w.begin};
  for (int k = 0; k < BLOCKS; ++k) {
    const block b = block_at(view, w.x + k % BLOCKS_X * BLOCK_X, w.y + k / BLOCKS_X * BLOCK_Y);
    const int n = list_splats(&t, w.end - w.begin, &b);
    const depths d = bound_depth(&f, &t, n, &b);
    const weight_sums c = collect_fragments(&f, &t, n, &b, &d);
    const reals rounding = R(2.0) * UNIT * c.count;
    reals low[MEANS], high[MEANS];
    bound_means(&t, &c, &d, low, high);
    store_bounds(view, &b, z_low, z_high, 1, 0, d.least, d.greatest);
    store_bounds(view, &b, weight_low, weight_high, 1, 0, c.low * (R(1.0) - rounding), c.high * (R(1.0) + rounding));
    for (int j = 0; j < 3; ++j) {
      store_bounds(view, &b, albedo_low, albedo_high, 3, j, low[j], high[j]);
      store_bounds(view, &b, normal_low, normal_high, 3, j, low[NORMAL + j], high[NORMAL + j]);
    }
  }
}
