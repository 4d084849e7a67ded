// Attribute pass: every fragment no farther than depth(p) + epsilon adds weight * attribute, in splat order.
// A work-item takes one region of a tile, streams the tile's run again and keeps the region's sums to itself.

#include "arithmetic.h"
#include "ray.h"
#include "splat.h"
#include "transpose.h"
#include "fragment.h"
#include "weight.h"
#include "lanes.h"
#include "tile.h"

// The sums of a region, and what is accepted there.
typedef struct {
  real8 sums[REGION_PIXELS];
  uint count[REGION_PIXELS];
  real farthest[REACHED_PIXELS];
} target;

// What is the same for every fragment.
typedef struct {
  real near, far, falloff, inverse_radius2;
  constant real *table;
  int table_size, left, top;
} rules;

// What LANES pixels or splats add: all zero where a fragment does not exist or is not accepted.
typedef struct {
  reals weight, z;
  masks accepted;
} weighted;

#define FARTHEST(lane, p) farthest[p + offset[lane]]

// x and y count from the region's first pixel, `offset` (of each lane) from `farthest`.
static inline weighted weigh(const discs *s, const prefilters *p, reals x, reals y, masks in_box, const real *farthest,
                             const int *offset, const rules *r)
{
  const hit h = intersect(s, x + (real)r->left, y + (real)r->top);
  const fragment f = filter(s, p, &h, r->near, r->far, r->inverse_radius2);
  const masks accepted = f.exists & in_box & MASK(f.z <= (reals)EACH_LANE(FARTHEST, 0));
  weighted t = {(reals)R(0.0), (reals)R(0.0), accepted};
  if (!ANY(accepted)) return t;
  t.weight = SELECT(R(0.0), weight_of(f.r2, r->falloff, r->table, r->table_size), accepted);
  t.z = SELECT(R(0.0), f.z, accepted);
  return t;
}

// Adding zero leaves a sum's bits as they are.
static inline void put(target *t, int p, const real8 *attributes, const weighted *f, int lane)
{
  accumulate(&t->sums[p], attributes, LANE_OF(f->weight, lane), LANE_OF(f->z, lane));
  t->count[p] -= WHOLE_OF(f->accepted, lane);
}

// LANES splats in small boxes, pixel by pixel of each; then splat by splat, in order, into the sums.
static inline void small_boxes(target *t, global const SplatAttributes *attributes, const int *place, int num,
                               const discs *s, const prefilters *p, const boxes *b, const rules *r)
{
  weighted found[SMALL * SMALL];
  const counted_boxes c = count_boxes(b);
  int offset[LANES];
  for (int lane = 0; lane < LANES; ++lane) offset[lane] = WHOLE_OF(c.first, lane);
  for (int y = 0; y < SMALL && ANY(MASK(c.down > (bits)y)); ++y)
    for (int x = 0; x < SMALL && ANY(MASK(c.across > (bits)x)); ++x)
      found[y * SMALL + x] =
          weigh(s, p, b->x_first + (real)x, b->y_first + (real)y, MASK(c.across > (bits)x) & MASK(c.down > (bits)y),
                t->farthest + y * REGION + x, offset, r);
  for (int lane = 0; lane < num; ++lane) {
    real8 values;
    load_attributes(&values, attributes + place[lane]);
    const int across = WHOLE_OF(c.across, lane), down = WHOLE_OF(c.down, lane);
    for (int y = 0; y < down; ++y)
      for (int x = 0; x < across; ++x) put(t, offset[lane] + y * REGION + x, &values, &found[y * SMALL + x], lane);
  }
}

// One splat in a box of any size, LANES pixels at a time.
static inline void large_box(target *t, global const SplatAttributes *attributes, global const ProjectedSplat *record,
                             int first, int across, int down, const rules *r)
{
  const ProjectedSplat whole = *record;
  const discs s = disc_of(&whole);
  const SplatAttributes own = *attributes;
  const prefilters p = prefilter_of(&whole, &own);
  real8 values;
  load_attributes(&values, attributes);
  int offset[LANES];
  block_offsets(offset);
  for (int y = 0; y < down; y += BLOCK_Y)
    for (int x = 0; x < across; x += BLOCK_X) {
      const int q = first + y * REGION + x;
      const reals dx = (real)x + LANE_X, dy = (real)y + LANE_Y;
      const weighted f = weigh(&s, &p, (real)(first % REGION) + dx, (real)(first / REGION) + dy,
                               MASK(dx < (real)across) & MASK(dy < (real)down), t->farthest + q, offset, r);
      if (!ANY(f.accepted)) continue;
      const int columns = least(BLOCK_X, across - x), rows = least(BLOCK_Y, down - y);
      for (int row = 0; row < rows; ++row)
        for (int column = 0; column < columns; ++column)
          put(t, q + row * REGION + column, &values, &f, row * BLOCK_X + column);
    }
}

#define LOW(lane, boxes) boxes[place[lane]].x
#define HIGH(lane, boxes) boxes[place[lane]].y
#define CENTER_Z(lane, records) records[place[lane]].center_z
#define PREFILTER_X(lane, attributes) attributes[place[lane]].prefilter_x
#define PREFILTER_Y(lane, attributes) attributes[place[lane]].prefilter_y

static inline void batch(target *t, global const ProjectedSplat *records, global const SplatAttributes *attributes,
                         global const uint2 *attribute_boxes, const int *place, int num, const region *w,
                         const rules *r)
{
  const boxes b = boxes_of((masks)EACH_LANE(LOW, attribute_boxes), (masks)EACH_LANE(HIGH, attribute_boxes), num, w);
  if (all_small(&b)) {
    masks low, high;
    const discs s = load_discs(records, place, &low, &high);
    const prefilters p = {(reals)EACH_LANE(PREFILTER_X, attributes), (reals)EACH_LANE(PREFILTER_Y, attributes),
                          (reals)EACH_LANE(CENTER_Z, records)};
    small_boxes(t, attributes, place, num, &s, &p, &b, r);
    return;
  }
  const counted_boxes c = count_boxes(&b);
  for (int lane = 0; lane < num; ++lane)
    large_box(t, attributes + place[lane], records + place[lane], WHOLE_OF(c.first, lane), WHOLE_OF(c.across, lane),
              WHOLE_OF(c.down, lane), r);
}

// Nothing yet, and the farthest that is accepted at each pixel of the image; return the farthest of all.
static inline real begin_target(target *t, constant View *view, const region *w, global const real *depth, real epsilon,
                                int along_ray)
{
  real farthest = -(real)INFINITY;
  for (int p = 0; p < REACHED_PIXELS; ++p) t->farthest[p] = -(real)INFINITY;
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
        farthest = LANE_OF(f, lane) > farthest ? LANE_OF(f, lane) : farthest;
      }
    }
  return farthest;
}

typedef struct {
  global real *weight, *color, *normal, *depth;
  global uint *count;
} sum_images;

static inline void write_sums(const sum_images *to, const target *t, constant View *view, const region *w)
{
  for (int y = 0; y < least(REGION, view->height - w->y); ++y)
    for (int x = 0; x < least(REGION, view->width - w->x); ++x) {
      const long q = (long)(w->y + y) * view->width + w->x + x;
      const real8 s = t->sums[y * REGION + x];
      to->weight[q] = s.SUM_WEIGHT;
      to->color[3 * q] = s.s0;
      to->color[3 * q + 1] = s.s1;
      to->color[3 * q + 2] = s.s2;
      to->normal[3 * q] = s.s3;
      to->normal[3 * q + 1] = s.s4;
      to->normal[3 * q + 2] = s.s5;
      to->depth[q] = s.SUM_Z;
      to->count[q] = t->count[y * REGION + x];
    }
}

static inline void write_zeros(global real *image, long first, int num)
{
  for (int i = 0; i < num; ++i) image[first + i] = R(0.0);
}

// The same where there is nothing: half of an image may be background.
static inline void write_nothing(const sum_images *to, constant View *view, const region *w)
{
  const int across = least(REGION, view->width - w->x);
  for (int y = 0; y < least(REGION, view->height - w->y); ++y) {
    const long q = (long)(w->y + y) * view->width + w->x;
    write_zeros(to->weight, q, across);
    write_zeros(to->color, 3 * q, 3 * across);
    write_zeros(to->normal, 3 * q, 3 * across);
    write_zeros(to->depth, q, across);
    for (int x = 0; x < across; ++x) to->count[q + x] = 0;
  }
}

kernel void attributes(constant View *view, global const ProjectedSplat *records,
                       global const SplatAttributes *splat_attributes, global const uint2 *boxes,
                       global const real *near_z, global const int *tile_begin, const int first_tile,
                       const int tiles_x, const real epsilon, const int along_ray, const real falloff,
                       const real inverse_radius2, constant real *table, const int table_size,
                       global const real *depth, global real *weight_sum, global real *color_sum,
                       global real *normal_sum, global real *depth_sum, global uint *count)
{
  const region w = region_of(get_global_id(0), first_tile, tiles_x);
  const int begin = tile_begin[w.run], end = tile_begin[w.run + 1];
  const sum_images to = {weight_sum, color_sum, normal_sum, depth_sum, count};
  if (begin >= end) {
    write_nothing(&to, view, &w);
    return;
  }
  const rules r = {view->near, view->far, falloff, inverse_radius2, table, table_size,
                   w.x + view->first_column, w.y + view->first_row};
  target t;
  const real farthest = begin_target(&t, view, &w, depth, epsilon, along_ray);
#define TAKE(place, num) batch(&t, records, splat_attributes, boxes, place, num, &w, &r)
  STREAM(near_z, begin, end, farthest, TAKE)
  write_sums(&to, &t, view, &w);
}
