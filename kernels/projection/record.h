// Provides the projection's result for LANES splats, and store_records, which writes it as records.

#include "arithmetic/reals.h"
#include "arithmetic/vectors.h"
#include "arithmetic/lanes.h"
#include "arithmetic/transpose.h"
#include "splat/disc.h"
#include "splat/extra.h"

// All that the raster passes need of LANES splats.
typedef struct {
  reals pixel_x, pixel_y, offset_x, offset_y;
  reals u_x, u_y, u_1, v_x, v_y, v_1, g_x, g_y, z;
  reals normal_x, normal_y, normal_z, prefilter_x, prefilter_y, center_z;
  boxes disc, drawn;  // the pixels of the disc; of disc and pre-filter
  reals near_z;       // a lower bound of the fragments' depths
#if EXTRA || SHADING == PER_SPLAT
  reals3 center;  // eye space
  masks turned;   // whether the normal was turned toward the eye
  extras extra;
#endif
} projected;

// A box as two words of a record: x_min and y_min, x_max and y_max, 16 bits each.
typedef struct {
  masks low, high;
} box_words;

static inline box_words words_of(const boxes *b)
{
  box_words w = {(whole_of(b->x_first) & (bits)0xffff) | (whole_of(b->y_first) << (bits)16),
                 (whole_of(b->x_last) & (bits)0xffff) | (whole_of(b->y_last) << (bits)16)};
  return w;
}

// The buffers of the records, one record per entry of the tile lists.
typedef struct {
  global ProjectedSplat *records;
  global SplatAttributes *attributes;
  global uint2 *boxes;
  global real *disc_near_z, *near_z;
} outputs;

// Write the records of the first `num` lanes' entries. near_z is NaN for a splat without pixels.
static inline void store_records(const outputs *to, const int *entry, int num, const projected *s, reals3 color)
{
  const box_words disc = words_of(&s->disc), drawn = words_of(&s->drawn);
#if DOUBLE
  const reals box_low = AS_REALS((disc.low & (bits)0xffffffffL) | (disc.high << (bits)32)), box_high = R(0.0);
#else
  const reals box_low = AS_REALS(disc.low), box_high = AS_REALS(disc.high);
#endif
  eight first = {{s->pixel_x, s->pixel_y, s->offset_x, s->offset_y, s->u_x, s->u_y, s->v_x, s->v_y}};
  STORE_EIGHT(first, num, to->records + entry[lane]);
  eight second = {{s->g_x, s->g_y, s->z, s->u_1, s->v_1, s->center_z, box_low, box_high}};
  STORE_EIGHT(second, num, &to->records[entry[lane]].g_x);
  eight third = {{color.x, color.y, color.z, s->normal_x, s->normal_y, s->normal_z, s->prefilter_x, s->prefilter_y}};
  STORE_EIGHT(third, num, to->attributes + entry[lane]);
  const masks no_disc = MASK(s->disc.x_first > s->disc.x_last), nothing = MASK(s->drawn.x_first > s->drawn.x_last);
  const reals disc_near_z = SELECT(s->near_z, (real)NAN, no_disc), near_z = SELECT(s->near_z, (real)NAN, nothing);
  for (int lane = 0; lane < num; ++lane) {
    to->boxes[entry[lane]] = (uint2)(WHOLE_OF(drawn.low, lane), WHOLE_OF(drawn.high, lane));
    to->disc_near_z[entry[lane]] = LANE_OF(disc_near_z, lane);
    to->near_z[entry[lane]] = LANE_OF(near_z, lane);
  }
}
