// The visibility pass: depth(p) = min z over the splats whose disc the pixel's ray hits, and the splat with that z.
//
// A work-item takes one region of a tile and streams the tile's run of records. The pre-filter has no influence here.
//
// BEHIND_FRONT  1: start from the depth of the front layer (occlusion.h), 0: from +inf

#include "arithmetic/reals.h"
#include "arithmetic/divide.h"
#include "arithmetic/lanes.h"
#include "splat/disc.h"
#include "splat/extra.h"
#include "passes/tile.h"

// The nearest hit so far at each pixel of a region.
typedef struct {
  real depth[REACHED_PIXELS] __attribute__((aligned(sizeof(reals))));
  uint particleid[REGION_PIXELS];
  int left, top;  // the region's first pixel in the image, which may exceed the drawn window
} nearest_hits;

// At equal depths the lower splat index wins, so the order of splats does not matter.
static inline void keep_nearest(nearest_hits *f, int p, real z, uint id)
{
  const real depth = f->depth[p];
  const uint particleid = f->particleid[p];
  const int closer = (z < depth) | ((z == depth) & (id < particleid));
  f->depth[p] = closer ? z : depth;
  f->particleid[p] = closer ? id : particleid;
}

// Hits of discs within near..far, no farther than the nearest hit so far.
typedef struct {
  reals z;
  masks in_front;
} visible_hits;

#define DEPTH(lane, depth) depth[offset[lane]]

// `depth` points to the nearest depths so far, `offset` leads from there to each lane's. Rays that miss the disc but
// hit its elliptic footprint get `center_z`.
static inline visible_hits visible_hits_at(const discs *s, const extras *e, reals center_z, reals x, reals y,
                                           masks in_box, real near, real far, const real *depth, const int *offset)
{
  const hit h = intersect(s, x, y);
#if ELLIPSE
  const masks covered = MASK(ellipse_radius2(e, &e->shape, &h) <= R(1.0)) & kept_by_lines(e, &h);
#else
  const masks covered = h.inside & kept_by_lines(e, &h);
#endif
  visible_hits m = {(reals)R(0.0), covered & in_box};
  if (!ANY(m.in_front)) return m;
  m.z = hit_depth(s, &h, divide(R(1.0), h.den));
#if ELLIPSE
  m.z = SELECT(center_z, m.z, h.inside & MASK(m.z >= near) & MASK(m.z <= far));
#else
  m.in_front &= MASK(m.z >= near) & MASK(m.z <= far);
#endif
  m.in_front &= MASK(m.z <= (reals)EACH_LANE(DEPTH, depth));
  return m;
}

#if ELLIPSE
#define OF_RECORD(lane, field) records[place[lane]].field
#define CENTERS_Z ((reals)EACH_LANE(OF_RECORD, center_z))
#else
#define CENTERS_Z ((reals)R(0.0))
#endif

// See LANES splats in small boxes, pixel by pixel of all boxes at once.
static inline void see_small_boxes(nearest_hits *f, global const int *ids, const int *place, const discs *s,
                                   const extras *e, reals center_z, const boxes *b, real near, real far)
{
  const counted_boxes c = count_boxes(b);
  const reals left = b->x_first + (real)f->left, top = b->y_first + (real)f->top;
  int offset[LANES];
  for (int lane = 0; lane < LANES; ++lane) offset[lane] = WHOLE_OF(c.first, lane);
  for (int y = 0; y < SMALL && ANY(MASK(c.down > (bits)y)); ++y)
    for (int x = 0; x < SMALL && ANY(MASK(c.across > (bits)x)); ++x) {
      const masks in_box = MASK(c.across > (bits)x) & MASK(c.down > (bits)y);
      const int q = y * REGION + x;
      const visible_hits m =
          visible_hits_at(s, e, center_z, left + (real)x, top + (real)y, in_box, near, far, f->depth + q, offset);
      if (!ANY(m.in_front)) continue;
      for (int lane = 0; lane < LANES; ++lane)
        if (WHOLE_OF(m.in_front, lane)) keep_nearest(f, offset[lane] + q, LANE_OF(m.z, lane), ids[place[lane]]);
    }
}

// See one splat in a box of any size, LANES pixels at a time.
static inline void see_large_box(nearest_hits *f, global const ProjectedSplat *records,
                                 global const ProjectedExtra *extra, int entry, uint id, int first, int across,
                                 int down, real near, real far)
{
  const ProjectedSplat whole = records[entry];
  const discs s = disc_of(&whole);
  extras e;
  load_one_footprint(&e, extra, entry);
  const reals left = (real)(f->left + first % REGION) + LANE_X, top = (real)(f->top + first / REGION) + LANE_Y;
  int offset[LANES];
  block_offsets(offset);
  for (int y = 0; y < down; y += BLOCK_Y)
    for (int x = 0; x < across; x += BLOCK_X) {
      const masks in_box = MASK(LANE_X < (real)(across - x)) & MASK(LANE_Y < (real)(down - y));
      const int q = first + y * REGION + x;
      const visible_hits m = visible_hits_at(&s, &e, whole.center_z, left + (real)x, top + (real)y, in_box, near, far,
                                             f->depth + q, offset);
      if (!ANY(m.in_front)) continue;
      for (int lane = 0; lane < LANES; ++lane)
        if (WHOLE_OF(m.in_front, lane)) keep_nearest(f, q + offset[lane], LANE_OF(m.z, lane), id);
    }
}

static inline void see_batch(nearest_hits *f, global const ProjectedSplat *records, global const ProjectedExtra *extra,
                             global const int *ids, const int *place, int num, const region *w, real near, real far)
{
  masks low, high;
  const discs s = load_discs(records, place, &low, &high);
  const boxes b = boxes_of(low, high, num, w);
  if (all_small(&b)) {
    extras e;
    load_footprints(&e, extra, place);
    see_small_boxes(f, ids, place, &s, &e, CENTERS_Z, &b, near, far);
    return;
  }
  const counted_boxes c = count_boxes(&b);
  for (int lane = 0; lane < num; ++lane)
    see_large_box(f, records, extra, place[lane], ids[place[lane]], WHOLE_OF(c.first, lane), WHOLE_OF(c.across, lane),
              WHOLE_OF(c.down, lane), near, far);
}

// The depth behind which no hit can be the nearest at any pixel: +inf until every pixel is covered.
static inline real farthest_of(const nearest_hits *f)
{
  reals farthest = (reals)-(real)INFINITY;
  for (int p = 0; p < REGION_PIXELS; p += LANES) farthest = at_least(*(const reals *)(f->depth + p), farthest);
  real most = -(real)INFINITY;
  for (int lane = 0; lane < LANES; ++lane) most = LANE_OF(farthest, lane) > most ? LANE_OF(farthest, lane) : most;
  return most;
}

kernel void visibility(global const ProjectedSplat *records, global const ProjectedExtra *extra,
                       global const real *near_z, global const int *ids, const int first_entry,
                       global const int *tile_begin, const int first_tile, const int tiles_x, const int first_column,
                       const int first_row, const int width, const int height, const real near, const real far,
                       global real *depth, global uint *particleid)
{
  const region w = region_of(get_global_id(0), first_tile, tiles_x);
  const int begin = tile_begin[w.run], end = tile_begin[w.run + 1];
#if BEHIND_FRONT
  int first = begin;
  while (first < end && !(near_z[first] == near_z[first])) ++first;
  if (first >= end) return;  // the layer has no disc here
#endif
  nearest_hits f;
  f.left = w.x + first_column;
  f.top = w.y + first_row;
  for (int p = 0; p < REACHED_PIXELS; ++p) f.depth[p] = -(real)INFINITY;  // no hit is nearer outside the image
  for (int p = 0; p < REGION_PIXELS; ++p) f.particleid[p] = NO_SPLAT;
  for (int y = 0; y < least(REGION, height - w.y); ++y)
    for (int x = 0; x < least(REGION, width - w.x); ++x) {
#if BEHIND_FRONT
      f.depth[y * REGION + x] = depth[(long)(w.y + y) * width + w.x + x];
      f.particleid[y * REGION + x] = particleid[(long)(w.y + y) * width + w.x + x];
#else
      f.depth[y * REGION + x] = (real)INFINITY;
#endif
    }
#define SEE_BATCH(place, num) see_batch(&f, records, extra, ids + first_entry, place, num, &w, near, far)
  STREAM(near_z, begin, end, farthest_of(&f), SEE_BATCH)
  for (int p = 0; p < REGION_PIXELS; ++p) {
    const int x = w.x + p % REGION, y = w.y + p / REGION;
    if (x >= width || y >= height) continue;
    depth[(long)y * width + x] = f.depth[p];
    particleid[(long)y * width + x] = f.particleid[p];
  }
}
