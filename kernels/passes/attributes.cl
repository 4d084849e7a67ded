// The attribute pass: each fragment no farther than depth(p) + epsilon adds weight * attribute, in splat order.
//
// A work-item takes one region of a tile, streams the tile's run of records and keeps the sums of its region private.
//
// CHANNELS  1: six further channels of each splat are summed, 0: color and normal

#include "arithmetic/reals.h"
#include "arithmetic/lanes.h"
#include "arithmetic/transpose.h"
#include "splat/disc.h"
#include "splat/extra.h"
#include "splat/fragment.h"
#include "passes/contribution.h"
#include "passes/tile.h"

// The sums of a region, and the greatest accepted depth at each of its pixels.
typedef struct {
  real8 sums[REGION_PIXELS];
  uint count[REGION_PIXELS];
  real farthest[REACHED_PIXELS];
#if FILTER_DEPTH == FRONT_DEPTH
  real front[REACHED_PIXELS];  // depth(p)
#endif
} region_sums;

static inline void add_to_pixel(region_sums *t, int p, const real8 *attributes, const contribution *f, int lane)
{
  add_lane(&t->sums[p], attributes, f, lane);
  t->count[p] -= WHOLE_OF(f->accepted, lane);
}

#define FARTHEST_AT(lane, p) t->farthest[p + offset[lane]]
#if FILTER_DEPTH == FRONT_DEPTH
#define FRONT_AT(lane, p) t->front[p + offset[lane]]
#else
#define FRONT_AT(lane, p) R(0.0)
#endif

// The data of each entry of the tile lists.
typedef struct {
  global const ProjectedSplat *records;
  global const ProjectedExtra *extra;
  global const SplatAttributes *attributes;
  global const uint2 *boxes;
  global const real *channels;  // eight per splat, of which six are used
  global const int *ids;
} entries;

// The values that an entry's weights multiply.
static inline void load_values(real8 *values, const entries *in, int entry)
{
#if CHANNELS
  *values = ((global const unaligned8 *)(in->channels + 8 * (long)in->ids[entry]))->values;
  values->SUM_WEIGHT = R(1.0);
#else
  load_attributes(values, in->attributes + entry);
#endif
}

// Add LANES splats in small boxes: compute pixel by pixel of all boxes at once, then add splat by splat, in order.
static inline void add_small_boxes(region_sums *t, const entries *in, const int *place, int num, const discs *s,
                                   const prefilters *p, const extras *e, const boxes *b, const fragment_settings *r)
{
  contribution found[SMALL * SMALL];
  const counted_boxes c = count_boxes(b);
  int offset[LANES];
  for (int lane = 0; lane < LANES; ++lane) offset[lane] = WHOLE_OF(c.first, lane);
  for (int y = 0; y < SMALL && ANY(MASK(c.down > (bits)y)); ++y)
    for (int x = 0; x < SMALL && ANY(MASK(c.across > (bits)x)); ++x)
      found[y * SMALL + x] = contribution_at(s, p, e, b->x_first + (real)x, b->y_first + (real)y,
                                   MASK(c.across > (bits)x) & MASK(c.down > (bits)y),
                                   (reals)EACH_LANE(FRONT_AT, y * REGION + x),
                                   (reals)EACH_LANE(FARTHEST_AT, y * REGION + x), r);
  for (int lane = 0; lane < num; ++lane) {
    real8 values;
    load_values(&values, in, place[lane]);
    const int across = WHOLE_OF(c.across, lane), down = WHOLE_OF(c.down, lane);
    for (int y = 0; y < down; ++y)
      for (int x = 0; x < across; ++x)
        add_to_pixel(t, offset[lane] + y * REGION + x, &values, &found[y * SMALL + x], lane);
  }
}

// Add one splat in a box of any size, LANES pixels at a time.
static inline void add_large_box(region_sums *t, const entries *in, int entry, int first, int across, int down,
                                 const fragment_settings *r)
{
  const ProjectedSplat whole = in->records[entry];
  const discs s = disc_of(&whole);
  const SplatAttributes own = in->attributes[entry];
  const prefilters p = prefilter_of(&whole, &own);
  extras e;
  load_one_extra(&e, in->extra, in->attributes, entry);
  real8 values;
  load_values(&values, in, entry);
  int offset[LANES];
  block_offsets(offset);
  for (int y = 0; y < down; y += BLOCK_Y)
    for (int x = 0; x < across; x += BLOCK_X) {
      const int q = first + y * REGION + x;
      const reals dx = (real)x + LANE_X, dy = (real)y + LANE_Y;
      const contribution f = contribution_at(&s, &p, &e, (real)(first % REGION) + dx, (real)(first / REGION) + dy,
                               MASK(dx < (real)across) & MASK(dy < (real)down), (reals)EACH_LANE(FRONT_AT, q),
                               (reals)EACH_LANE(FARTHEST_AT, q), r);
      if (!ANY(f.accepted)) continue;
      const int columns = least(BLOCK_X, across - x), rows = least(BLOCK_Y, down - y);
      for (int row = 0; row < rows; ++row)
        for (int column = 0; column < columns; ++column)
          add_to_pixel(t, q + row * REGION + column, &values, &f, row * BLOCK_X + column);
    }
}

#define BOX_LOW(lane, boxes) boxes[place[lane]].x
#define BOX_HIGH(lane, boxes) boxes[place[lane]].y
#define CENTER_Z(lane, records) records[place[lane]].center_z
#define PREFILTER_X(lane, attributes) attributes[place[lane]].prefilter_x
#define PREFILTER_Y(lane, attributes) attributes[place[lane]].prefilter_y

static inline void add_batch(region_sums *t, const entries *in, const int *place, int num, const region *w,
                             const fragment_settings *r)
{
  const boxes b = boxes_of((masks)EACH_LANE(BOX_LOW, in->boxes), (masks)EACH_LANE(BOX_HIGH, in->boxes), num, w);
  if (all_small(&b)) {
    masks low, high;
    const discs s = load_discs(in->records, place, &low, &high);
    const prefilters p = {(reals)EACH_LANE(PREFILTER_X, in->attributes), (reals)EACH_LANE(PREFILTER_Y, in->attributes),
                          (reals)EACH_LANE(CENTER_Z, in->records)};
    extras e;
    load_extras(&e, in->extra, in->attributes, place);
    add_small_boxes(t, in, place, num, &s, &p, &e, &b, r);
    return;
  }
  const counted_boxes c = count_boxes(&b);
  for (int lane = 0; lane < num; ++lane)
    add_large_box(t, in, place[lane], WHOLE_OF(c.first, lane), WHOLE_OF(c.across, lane), WHOLE_OF(c.down, lane), r);
}

// Clear the sums and set the greatest accepted depth of each pixel in the image; return the greatest of all.
static inline real begin_sums(region_sums *t, constant View *view, const region *w, global const real *depth,
                              real epsilon, int along_ray)
{
  real farthest = -(real)INFINITY;
  for (int p = 0; p < REACHED_PIXELS; ++p) t->farthest[p] = -(real)INFINITY;
#if FILTER_DEPTH == FRONT_DEPTH
  for (int p = 0; p < REACHED_PIXELS; ++p) t->front[p] = (real)INFINITY;
#endif
  for (int p = 0; p < REGION_PIXELS; ++p) {
    t->sums[p] = (real8)R(0.0);
    t->count[p] = 0;
  }
  const int across = least(REGION, view->width - w->x);
  for (int y = 0; y < least(REGION, view->height - w->y); ++y)
    for (int x = 0; x < across; x += LANES) {
      reals z, columns;
      const int num = least(LANES, across - x);
      for (int lane = 0; lane < LANES; ++lane) {
        ((real *)&columns)[lane] = (real)(w->x + x + lane);
        ((real *)&z)[lane] = depth[(long)(w->y + y) * view->width + w->x + x + least(lane, num - 1)];
      }
      const reals f = farthest_accepted(view, columns, (reals)(real)(w->y + y), z, epsilon, along_ray);
      for (int lane = 0; lane < num; ++lane) {
        t->farthest[y * REGION + x + lane] = LANE_OF(f, lane);
#if FILTER_DEPTH == FRONT_DEPTH
        t->front[y * REGION + x + lane] = LANE_OF(z, lane);
#endif
        farthest = LANE_OF(f, lane) > farthest ? LANE_OF(f, lane) : farthest;
      }
    }
  return farthest;
}

typedef struct {
  global real *weight, *color, *normal, *depth;
  global uint *count;
} sum_images;

static inline void write_sums(const sum_images *to, const region_sums *t, constant View *view, const region *w)
{
  for (int y = 0; y < least(REGION, view->height - w->y); ++y)
    for (int x = 0; x < least(REGION, view->width - w->x); ++x) {
      const long q = (long)(w->y + y) * view->width + w->x + x;
      const real8 s = as_values(t->sums[y * REGION + x]);
      to->color[3 * q] = s.s0;
      to->color[3 * q + 1] = s.s1;
      to->color[3 * q + 2] = s.s2;
      to->normal[3 * q] = s.s3;
      to->normal[3 * q + 1] = s.s4;
      to->normal[3 * q + 2] = s.s5;
#if !CHANNELS
      to->weight[q] = s.SUM_WEIGHT;
      to->depth[q] = s.SUM_Z;
      to->count[q] = t->count[y * REGION + x];
#endif
    }
}

static inline void write_zeros(global real *image, long first, int num)
{
  for (int i = 0; i < num; ++i) image[first + i] = R(0.0);
}

// Write the sums of a region without records: half of an image may be background.
static inline void write_nothing(const sum_images *to, constant View *view, const region *w)
{
  const int across = least(REGION, view->width - w->x);
  for (int y = 0; y < least(REGION, view->height - w->y); ++y) {
    const long q = (long)(w->y + y) * view->width + w->x;
    write_zeros(to->color, 3 * q, 3 * across);
    write_zeros(to->normal, 3 * q, 3 * across);
#if !CHANNELS
    write_zeros(to->weight, q, across);
    write_zeros(to->depth, q, across);
    for (int x = 0; x < across; ++x) to->count[q + x] = 0;
#endif
  }
}

kernel void attributes(constant View *view, global const ProjectedSplat *records, global const ProjectedExtra *extra,
                       global const SplatAttributes *splat_attributes, global const uint2 *boxes,
                       global const real *near_z, global const real *channels, global const int *ids,
                       const int first_entry, global const int *tile_begin, const int first_tile, const int tiles_x,
                       const real epsilon, const int along_ray, const real falloff, const real inverse_radius2,
                       constant real *table, const int table_size, global const real *depth, global real *weight_sum,
                       global real *color_sum, global real *normal_sum, global real *depth_sum,
                       global uint *count FRAGMENT_LIGHT_PARAMETERS)
{
  const region w = region_of(get_global_id(0), first_tile, tiles_x);
  const int begin = tile_begin[w.run], end = tile_begin[w.run + 1];
  const sum_images to = {weight_sum, color_sum, normal_sum, depth_sum, count};
  if (begin >= end) {
    write_nothing(&to, view, &w);
    return;
  }
  const fragment_settings r = {view->near, view->far, falloff, inverse_radius2, table, table_size,
                   w.x + view->first_column, w.y + view->first_row FRAGMENT_LIGHT_ARGUMENTS};
  const entries in = {records, extra, splat_attributes, boxes, channels, ids + first_entry};
  region_sums t;
  const real farthest = begin_sums(&t, view, &w, depth, epsilon, along_ray);
#define ADD_BATCH(place, num) add_batch(&t, &in, place, num, &w, &r)
  STREAM(near_z, begin, end, farthest, ADD_BATCH)
  write_sums(&to, &t, view, &w);
}
