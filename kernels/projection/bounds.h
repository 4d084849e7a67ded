// Provides the bounds of discs in the image, the pixels within them, and the least depth at these pixels.
//
// ORTHOGRAPHIC  1: the projection is orthographic, 0: perspective

#include "arithmetic/reals.h"
#include "arithmetic/divide.h"
#include "splat/disc.h"
#include "projection/record.h"

#define NOWHERE R(1e9)  // a coordinate far from every pixel
#define CLEAR R(1e-4)   // a disc whose least z is below this share of its center's has no finite bounds

// The disc's extent [middle - reach, middle + reach] along one image axis, pixels from its projected center.
typedef struct {
  reals middle, reach;
} extent;

// The tangents to the projected conic, relative to the center, so that nothing cancels.
static inline extent perspective_extent(reals slope, reals u, reals v, reals uz, reals vz, reals w, real focal)
{
  reals pu = u - slope * uz, pv = v - slope * vz;
  reals pt = pu * uz + pv * vz;
  reals inverse = divide(focal, w);
  extent e = {-pt * inverse, square_root(pt * pt + (pu * pu + pv * pv) * w) * inverse};
  return e;
}

// The extent of a disc too near the eye plane for those tangents: its box in eye space, cut at near.
static inline extent near_extent(reals center, reals reach, reals z_low, reals z_high, reals origin, real focal)
{
  reals low = center - reach, high = center + reach;
  low = divide(low, SELECT(z_low, z_high, MASK(low > R(0.0)))) * focal;
  high = divide(high, SELECT(z_high, z_low, MASK(high > R(0.0)))) * focal;
  reals slack = (magnitude(low) + magnitude(high)) * R(1e-5);
  extent e = {(low + high) * R(0.5) - origin, (high - low) * R(0.5) + slack};
  return e;
}

// The middle of the bounds of the projected corners c +- t_u +- t_v along one image axis, from the projected center.
static inline reals corners_middle(reals slope, reals u, reals v, reals uz, reals vz, reals z, real focal)
{
  const reals pu = u - slope * uz, pv = v - slope * vz;
  const reals sum = pu + pv, difference = pu - pv, sum_z = uz + vz, difference_z = uz - vz;
  const reals a = divide(sum, z + sum_z), b = divide(-sum, z - sum_z);
  const reals c = divide(difference, z + difference_z), d = divide(-difference, z - difference_z);
  const reals low = at_most(at_most(a, b), at_most(c, d)), high = at_least(at_least(a, b), at_least(c, d));
  return (low + high) * (R(0.5) * focal);
}

// Bounds relative to the reference point, pixels; low > high: empty.
typedef struct {
  reals x_low, x_high, y_low, y_high;
} bounds;

static inline bounds bounds_of(extent x, extent y, reals slack, masks visible)
{
  bounds b = {
      SELECT(NOWHERE, x.middle - x.reach - slack, visible), SELECT(-NOWHERE, x.middle + x.reach + slack, visible),
      SELECT(NOWHERE, y.middle - y.reach - slack, visible), SELECT(-NOWHERE, y.middle + y.reach + slack, visible)};
  return b;
}

static inline bounds around_both(bounds a, bounds b)
{
  bounds c = {at_most(a.x_low, b.x_low), at_least(a.x_high, b.x_high), at_most(a.y_low, b.y_low),
              at_least(a.y_high, b.y_high)};
  return c;
}

// Among the image's pixels [first, first + size), counted from `first`: the first pixel with its center at or above
// `low`, and the last with its center at or below `high`.
static inline reals first_pixel(reals low, real first, real size)
{
  return round_up(at_most(at_least(low, (reals)first), (reals)(first + size))) - first;
}

static inline reals last_pixel(reals high, real first, real size)
{
  return round_down(at_least(at_most(high, (reals)(first + size - R(1.0))), (reals)(first - R(1.0)))) - first;
}

// The window's pixels with centers within the bounds, counted from its first pixel.
static inline boxes pixels_of(constant View *view, const projected *s, const bounds *b)
{
  // The coordinates of a reference point far outside the image have coarse rounding errors.
  const reals coarse_x = magnitude(s->pixel_x) * R(2.4e-7), coarse_y = magnitude(s->pixel_y) * R(2.4e-7);
  const real left = (real)view->first_column, width = (real)view->width;
  const real top = (real)view->first_row, height = (real)view->height;
  boxes p = {first_pixel(s->pixel_x + (s->offset_x + b->x_low - coarse_x), left, width),
             last_pixel(s->pixel_x + (s->offset_x + b->x_high + coarse_x), left, width),
             first_pixel(s->pixel_y + (s->offset_y + b->y_low - coarse_y), top, height),
             last_pixel(s->pixel_y + (s->offset_y + b->y_high + coarse_y), top, height)};
  // A NaN reference point counts as near every pixel, but empty bounds still mean no pixels.
  const masks none = MASK(b->x_low > b->x_high) | MASK(p.x_first > p.x_last) | MASK(p.y_first > p.y_last);
  p.x_first = SELECT(p.x_first, R(1.0), none);
  p.x_last = SELECT(p.x_last, R(0.0), none);
  return p;
}

#define MOST_STEPS R(2097152.0)  // pixels from a reference point; more are outside every image

// Cut a box to the pixels within `half_side` of the projected center, which is at (x, y) from the reference point.
// Whole pixels are counted from the reference pixel, so the decision errs by the roundings of the offset alone.
static inline void cut_to_point(constant View *view, const projected *s, boxes *b, reals x, reals y, reals half_side,
                                masks drawable)
{
  const reals reach = at_most(half_side, (reals)MOST_STEPS);
  const reals dx = at_least(at_most(s->offset_x + x, (reals)MOST_STEPS), (reals)-MOST_STEPS);
  const reals dy = at_least(at_most(s->offset_y + y, (reals)MOST_STEPS), (reals)-MOST_STEPS);
  const reals column = s->pixel_x - (real)view->first_column, row = s->pixel_y - (real)view->first_row;
  const boxes cut = {
      at_least(b->x_first, column + round_up(dx - reach)), at_most(b->x_last, column + round_down(dx + reach)),
      at_least(b->y_first, row + round_up(dy - reach)), at_most(b->y_last, row + round_down(dy + reach))};
  const masks none = ~drawable | MASK(cut.x_first > cut.x_last) | MASK(cut.y_first > cut.y_last) |
                     MASK(b->x_first > b->x_last) | MASK(b->y_first > b->y_last);
  b->x_first = SELECT(cut.x_first, R(1.0), none);
  b->x_last = SELECT(cut.x_last, R(0.0), none);
  b->y_first = SELECT(cut.y_first, R(0.0), none);
  b->y_last = SELECT(cut.y_last, R(0.0), none);
}

// The least value of hit_depth (splat/disc.h) at the pixels of `drawn`. Each of its roundings is monotonic, so the
// least depth is at a corner, to the bit. No slack would be safe for nearly parallel tangents.
static inline reals least_depth(constant View *view, const projected *s)
{
  const real x = (real)view->first_column, y = (real)view->first_row;
  const reals left = ((s->drawn.x_first + x) - s->pixel_x) - s->offset_x;
  const reals right = ((s->drawn.x_last + x) - s->pixel_x) - s->offset_x;
  const reals top = ((s->drawn.y_first + y) - s->pixel_y) - s->offset_y;
  const reals bottom = ((s->drawn.y_last + y) - s->pixel_y) - s->offset_y;
#if ORTHOGRAPHIC
  return (at_most(s->g_x * left, s->g_x * right) + at_most(s->g_y * top, s->g_y * bottom)) + s->z;
#else
  const reals den = (at_least(s->g_x * left, s->g_x * right) + at_least(s->g_y * top, s->g_y * bottom)) + R(1.0);
  return divide(R(1.0), den) * s->z;
#endif
}
