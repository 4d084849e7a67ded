// Provides the region of pixels of a work-item, and the stream of its tile's records, LANES at a time.
//
// TILE    side of a tile, pixels
// REGION  side of a region, pixels: the whole tile, which suits a CPU; a part of it where a few tiles hold most splats;
//         or one pixel with LANES 1, which suits a GPU

#include "arithmetic/reals.h"
#include "arithmetic/lanes.h"
#include "arithmetic/transpose.h"
#include "splat/disc.h"

#define REGIONS_X (TILE / REGION)  // of one tile
#define REGIONS (REGIONS_X * REGIONS_X)
#define REGION_PIXELS (REGION * REGION)
#define SMALL 4  // boxes up to SMALL x SMALL pixels run LANES splats at a time, others LANES pixels at a time
#define REACHED_PIXELS (REGION_PIXELS + SMALL * REGION + SMALL)  // of small boxes that begin in the region

// The region of a work-item: its tile's run of records, and its first pixel.
typedef struct {
  int run, x, y;
} region;

static inline region region_of(int item, int first_tile, int tiles_x)
{
  const int tile = first_tile + item / REGIONS, part = item % REGIONS;
  region w = {item / REGIONS, tile % tiles_x * TILE + part % REGIONS_X * REGION,
              tile / tiles_x * TILE + part / REGIONS_X * REGION};
  return w;
}

static inline discs load_discs(global const ProjectedSplat *records, const int *place, masks *low, masks *high)
{
  LOAD_EIGHT(a, global, records + place[lane]);
  LOAD_EIGHT(b, global, &records[place[lane]].g_x);
#if DOUBLE
  *low = AS_BITS(b.v[6]) & (bits)0xffffffffL;
  *high = AS_BITS(b.v[6]) >> (bits)32;
#else
  *low = AS_BITS(b.v[6]);
  *high = AS_BITS(b.v[7]);
#endif
  discs d = {a.v[0], a.v[1], a.v[2], a.v[3], a.v[4], a.v[5], b.v[3], a.v[6], a.v[7], b.v[4], b.v[0], b.v[1], b.v[2]};
  return d;
}

static inline reals pixel_of(masks word, int shift)
{
  const bits above = sizeof(bits) * 8 - 16;
  return real_of((word << (bits)(above - shift)) >> above);
}

// The boxes of pairs of words, clipped to the region and relative to its first pixel; lanes from `num` on are empty.
static inline boxes boxes_of(masks low, masks high, int num, const region *w)
{
  const reals left = (reals)(real)w->x, top = (reals)(real)w->y, end = (reals)(real)(REGION - 1);
  boxes b = {at_least(pixel_of(low, 0) - left, R(0.0)), at_most(pixel_of(high, 0) - left, end),
             at_least(pixel_of(low, 16) - top, R(0.0)), at_most(pixel_of(high, 16) - top, end)};
  for (int lane = num; lane < LANES; ++lane) ((real *)&b.x_last)[lane] = R(-1.0);
  const masks none = MASK(b.x_first > b.x_last) | MASK(b.y_first > b.y_last);
  b.x_first = SELECT(b.x_first, R(0.0), none);
  b.x_last = SELECT(b.x_last, R(-1.0), none);
  b.y_first = SELECT(b.y_first, R(0.0), none);
  b.y_last = SELECT(b.y_last, R(-1.0), none);
  return b;
}

// LANES boxes as integers: the first pixel's index in the region, and the numbers of columns and rows.
typedef struct {
  masks first, across, down;
} counted_boxes;

static inline counted_boxes count_boxes(const boxes *b)
{
  counted_boxes c = {whole_of(b->y_first * (real)REGION + b->x_first), whole_of(b->x_last - b->x_first) + (bits)1,
                     whole_of(b->y_last - b->y_first) + (bits)1};
  return c;
}

// The offsets in the region from a block's first pixel to its LANES pixels.
static inline void block_offsets(int *offset)
{
  for (int lane = 0; lane < LANES; ++lane) offset[lane] = lane / BLOCK_X * REGION + lane % BLOCK_X;
}

static inline int all_small(const boxes *b)
{
  return LANES > 1 && !ANY(MASK(b->x_last - b->x_first >= (real)SMALL) | MASK(b->y_last - b->y_first >= (real)SMALL));
}

// Records tested at a time; those near enough are then taken LANES at a time.
#define QUEUE 128

// Append to a queue of `num` places those in [begin, end) whose records are no farther than `farthest`.
static inline int append_near(global const real *near_z, int begin, int end, real farthest, int *place, int num)
{
  for (int i = begin; i < end; ++i) {
    place[num] = i;
    num += near_z[i] <= farthest;  // false for NaN
  }
  return num;
}

// Take the records in [begin, end) that are no farther than `farthest`, an expression evaluated anew for every QUEUE
// records. TAKE(place, num) gets the places of num <= LANES records; the places from `num` on repeat valid records.
#define STREAM(near_z, begin, end, farthest, TAKE)                                                     \
  {                                                                                                    \
    int place[QUEUE + LANES], num = 0;                                                                 \
    for (int i = begin; i < end; i += QUEUE) {                                                         \
      num = append_near(near_z, i, least(i + QUEUE, end), farthest, place, num);                       \
      int done = 0;                                                                                    \
      for (; done + LANES <= num; done += LANES) TAKE(place + done, LANES);                            \
      num -= done;                                                                                     \
      for (int rest = 0; rest < num; ++rest) place[rest] = place[done + rest];                         \
    }                                                                                                  \
    if (num) {                                                                                         \
      for (int lane = num; lane < LANES; ++lane) place[lane] = place[0];                               \
      TAKE(place, num);                                                                                \
    }                                                                                                  \
  }
