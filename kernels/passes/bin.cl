// The bin pass: for each tile of the image, list the splats that may touch it, in splat order.
//
// This is a stable counting sort without atomics. Each chunk of consecutive splats counts its own entries, and writes
// them after those of the chunks before it. Bounds here are cheap and conservative: a box about the disc in eye space,
// in plain precision, plus all rounding errors. project.cl computes the exact bounds, which select pixels.
//
// LAYERED  1: each entry also gets an occlusion key (occlusion.h), so the projection skips occluded splats; 0: not

#include "arithmetic/reals.h"
#include "arithmetic/divide.h"
#include "arithmetic/vectors.h"
#include "arithmetic/lanes.h"
#include "splat/eye.h"
#include "splat/extra.h"
#include "passes/occlusion.h"

#define FACING_SLACK R(1.52587890625e-5)  // times |t_u||t_v||c|: ten times the error that can turn the sign of g.c
#define CENTER_SLACK R(4.7683716e-7)      // times the products that sum to a center's coordinate
#define TILT_SLACK R(0.032)               // times the larger side: project.cl's SLACK_TILT, halved, at the steepest
#define NEAR_SLACK R(1.1e-5)              // times the distance from the principal point: as in bounds.h's near_extent
#define PIXEL_SLACK R(0.03125)

// Limits within which the depths of a disc's fragments are safe: its tilt and the angle of its tangents (squares of
// cosine and sine), and its depth as a share of its center's z. DEPTH_SLACK times its extent plus DISTANCE_SLACK times
// |c| is then far above the errors of these depths.
#define SURE_TILT R(9.765625e-4)
#define SURE_ANGLE R(3.90625e-3)
#define SURE_DEEP R(0.25)
#define DEPTH_SLACK R(0.015625)
#define DISTANCE_SLACK R(1e-4)

// Load LANES numbers from index i, a multiple of LANES, of each plane of a structure-of-arrays buffer.
static inline reals3 load3(global const real *planes, int stride, int i)
{
  global const reals *x = (global const reals *)planes + i / LANES;
  reals3 v = {x[0], x[stride / LANES], x[2 * (long)(stride / LANES)]};
  return v;
}

static inline reals length1(reals3 v) { return magnitude(v.x) + magnitude(v.y) + magnitude(v.z); }

// The pixels along one axis that LANES splats may touch, both ends included; none if first > last.
typedef struct {
  reals first, last;
} pixel_range;

// The centers in eye space and their errors.
typedef struct {
  reals3 center;
  reals error, z_low, z_high;
  masks filtered;  // the pre-filter may cover pixels
  real around;     // radius of the pre-filter, pixels
} centers;

static inline real at_least_of(real a, real b) { return a > b ? a : b; }

// The pixels of a disc within `reach` of `center`, from the principal point.
static inline pixel_range disc_pixels(const centers *s, reals center, reals reach, real focal)
{
  pixel_range r = {(center - reach - s->error) * focal, (center + reach + s->error) * focal};
#if !ORTHOGRAPHIC
  r.first = divide(r.first, SELECT(s->z_low, s->z_high, MASK(r.first > R(0.0))));
  r.last = divide(r.last, SELECT(s->z_high, s->z_low, MASK(r.last > R(0.0))));
#endif
  return r;
}

// The pixels of a disc, with `slack` for its tilt, and of its pre-filter; or of an affine map's ellipse, which may
// extend by `spread` in the plane of the center.
static inline pixel_range touched_pixels(const centers *s, pixel_range disc, reals slack, reals center, reals spread,
                                         real focal, real principal)
{
  reals middle = center * focal, off = s->error * focal;
#if ELLIPSE == AFFINE
  off = off + spread * focal;
#endif
#if !ORTHOGRAPHIC
  const reals inverse = divide(R(1.0), s->center.z);
  middle = middle * inverse;
  off = (off + magnitude(middle) * s->error) * inverse * R(1.5);
#endif
  const reals rounding = (magnitude(disc.first) + magnitude(disc.last)) * NEAR_SLACK +
                         (magnitude((reals)principal) * CENTER_SLACK + PIXEL_SLACK);
  off = off + (s->around + rounding);
  const reals low = disc.first - (slack + rounding), high = disc.last + (slack + rounding);
  pixel_range r = {SELECT(low, at_most(low, middle - off), s->filtered) + principal,
             SELECT(high, at_least(high, middle + off), s->filtered) + principal};
  return r;
}

// The whole pixels of a range in an image of `size` pixels.
static inline pixel_range whole(pixel_range r, real size)
{
  pixel_range p = {round_up(at_most(at_least(r.first, R(-1.0)), size)),
                   round_down(at_least(at_most(r.last, size), R(-1.0)))};
  p.first = at_least(p.first, R(0.0));
  p.last = at_most(p.last, size - R(1.0));
  return p;
}

// Splats that certainly face away from the eye.
static inline masks surely_away(reals3 tu, reals3 tv, reals3 c, reals error)
{
  const reals3 g = cross3(tu, tv);
  const reals size = length1(tu) * length1(tv);
  if (ORTHOGRAPHIC) return MASK(g.z > size * FACING_SLACK);
  return MASK(dot3(g, c) > size * (length1(c) * FACING_SLACK + error * R(2.0)));
}

// The window's pixels that LANES splats may touch, and a lower bound of their fragments' depths, or 0.
typedef struct {
  pixel_range x, y;
  reals near_z;
} touched;

// The lower bound of the depths. `deep` and `extent` are half the sides of a box about the disc: along z, and their
// sum.
static inline reals sure_depth(reals3 tu, reals3 tv, reals3 c, reals error, reals deep, reals extent)
{
  const reals3 g = cross3(tu, tv);
  const reals along = ORTHOGRAPHIC ? g.z : dot3(g, c), area2 = dot3(g, g);
  const masks sure = MASK(along * along > area2 * (ORTHOGRAPHIC ? (reals)R(1.0) : dot3(c, c)) * SURE_TILT) &
                     MASK(area2 > dot3(tu, tu) * dot3(tv, tv) * SURE_ANGLE) & MASK(deep < c.z * SURE_DEEP);
  const reals z = (c.z - deep) - (extent * DEPTH_SLACK + length1(c) * DISTANCE_SLACK + error);
  return SELECT(R(0.0), at_least(z, R(0.0)), sure);
}

// `alive` is in and out: the splats that are asked for, and those of them that may touch a pixel.
static inline touched touched_by(constant View *view, reals3 world, reals3 tu_world, reals3 tv_world, masks *alive)
{
  const reals3 turned = rotate(view, world), tu = rotate(view, tu_world), tv = rotate(view, tv_world);
  const reals3 c = {turned.x + view->t0_hi, turned.y + view->t1_hi, turned.z + view->t2_hi};
  const reals error = (length1(world) + view->reach) * CENTER_SLACK;
  touched t = {{R(1.0), R(0.0)}, {R(1.0), R(0.0)}, R(0.0)};
  if (view->facing == CULL) *alive &= ~surely_away(tu, tv, c, error);
  // The bounds of the disc, or of the parallelogram about it, in which the pre-filter's center may be.
  const int corners = view->prefilter_center == AT_PARALLELOGRAM;
  const reals reach = corners ? magnitude(tu.z) + magnitude(tv.z) : square_root(tu.z * tu.z + tv.z * tv.z);
  const reals deep = reach * R(1.00001) + error;
  const reals near = view->near - magnitude_of(view->near) * R(1e-4);
  *alive &= MASK(c.z + deep >= near) & MASK(c.z - deep <= view->far + magnitude_of(view->far) * R(1e-4));
  if (!ANY(*alive)) return t;
  const masks in_front = MASK(c.z + error >= near);
  centers s = {c, error, c.z - deep, c.z + deep, in_front, view->prefilter_radius};
  if (!(view->prefilter | ELLIPSE)) s.filtered = 0;
  reals wide = square_root(tu.x * tu.x + tv.x * tv.x), high = square_root(tu.y * tu.y + tv.y * tv.y);
  if (corners) {
    wide = magnitude(tu.x) + magnitude(tv.x);
    high = magnitude(tu.y) + magnitude(tv.y);
  }
#if !ORTHOGRAPHIC
  // Only a disc that comes nearer to the eye plane than this is cut at near (bounds.h, CLEAR).
  const reals shallowest = SELECT(near, at_most(c.z * R(5e-5), near), in_front);
  s.z_low = SELECT(shallowest, s.z_low, MASK(s.z_low > shallowest));
#endif
  pixel_range x = disc_pixels(&s, c.x, wide, view->fx_hi), y = disc_pixels(&s, c.y, high, view->fy_hi);
  const reals slack = at_least(x.last - x.first, y.last - y.first) * TILT_SLACK;
  reals spread_x = R(0.0), spread_y = R(0.0);
#if ELLIPSE == AFFINE && ORTHOGRAPHIC
  spread_x = wide;
  spread_y = high;
#elif ELLIPSE == AFFINE
  const reals lean = divide(deep, magnitude(c.z));
  spread_x = wide + magnitude(c.x) * lean;
  spread_y = high + magnitude(c.y) * lean;
#endif
  x = touched_pixels(&s, x, slack, c.x, spread_x, view->fx_hi, view->cx_hi - (real)view->first_column);
  y = touched_pixels(&s, y, slack, c.y, spread_y, view->fy_hi, view->cy_hi - (real)view->first_row);
  const int around_bounds = (view->prefilter_center != AT_CENTER) | (view->low_pass_reach > R(0.0));
  if (around_bounds) {  // the pre-filter's center may be anywhere in the bounds
    const reals around = (reals)(at_least_of(view->prefilter_radius, view->low_pass_reach) + PIXEL_SLACK);
    x = (pixel_range){x.first - around, x.last + around};
    y = (pixel_range){y.first - around, y.last + around};
  }
#if !ORTHOGRAPHIC
  // The center is near the eye plane, or the disc is so large that the exact bounds overflow.
  const reals extent = (wide + high + deep) * length1(c) * R(4.0);
  const masks anywhere = (in_front & MASK(c.z < error * R(4.0))) | ~MASK(extent * extent < (real)INFINITY);
  x = (pixel_range){SELECT(x.first, R(0.0), anywhere), SELECT(x.last, (real)view->width, anywhere)};
  y = (pixel_range){SELECT(y.first, R(0.0), anywhere), SELECT(y.last, (real)view->height, anywhere)};
#endif
  t.x = whole(x, (real)view->width);
  t.y = whole(y, (real)view->height);
  *alive &= MASK(t.x.first <= t.x.last) & MASK(t.y.first <= t.y.last);
#if LAYERED
  t.near_z = sure_depth(tu, tv, c, error, deep, wide + high + deep);
#endif
  return t;
}

// The quarters of tiles' sides (occlusion.h) of pixels: column and row, 16 bits each, as in TouchedQuarters.
static inline masks quarters_of(reals x, reals y)
{
  return (whole_of(x) >> (bits)QUARTER_SHIFT) | ((whole_of(y) >> (bits)QUARTER_SHIFT) << (bits)16);
}

#define X_OF(pair) ((pair) & 0xffff)
#define Y_OF(pair) ((pair) >> 16)

#define FOR_EACH_TILE(l) /* four quarters a side */                 \
  for (int y = Y_OF((l).first) >> 2; y <= Y_OF((l).last) >> 2; ++y) \
    for (int x = X_OF((l).first) >> 2; x <= X_OF((l).last) >> 2; ++x)

// List each chunk's splats that may touch the image, with their quarters. For each tile, count them and find the
// nearest.
kernel void bin_count(constant View *view, global const real *center, global const real *tangent_u,
                      global const real *tangent_v, const int num_splats, const int stride, const int spread,
                      const int chunk_size, const int tiles_x, const int num_tiles, global TouchedQuarters *lists,
                      global int *num_listed, global int *tile_counts, global int *tile_nearest)
{
  const int chunk = get_global_id(0) * spread % get_global_size(0);
  const int begin = chunk * chunk_size, end = least(begin + chunk_size, num_splats);
  global int *counts = tile_counts + (long)chunk * num_tiles;
  for (int tile = 0; tile < num_tiles; ++tile) counts[tile] = 0;
#if LAYERED
  global int *nearest = tile_nearest + (long)chunk * num_tiles;
  for (int tile = 0; tile < num_tiles; ++tile) nearest[tile] = BEYOND_ALL;
#endif
  int place = begin;
  for (int i = begin; i < end; i += LANES) {
    masks alive = (masks)-1;
    const touched t =
        touched_by(view, load3(center, stride, i), load3(tangent_u, stride, i), load3(tangent_v, stride, i), &alive);
    if (!ANY(alive)) continue;
    const masks first = quarters_of(t.x.first, t.y.first), last = quarters_of(t.x.last, t.y.last);
    const int listed = place;
    for (int lane = 0; lane < least(LANES, end - i); ++lane) {
      const int near_z = NEAR_BITS(as_int((float)LANE_OF(t.near_z, lane)));
      lists[place] = (TouchedQuarters){i + lane, WHOLE_OF(first, lane), WHOLE_OF(last, lane), near_z};
      place -= WHOLE_OF(alive, lane);
    }
    for (int k = listed; k < place; ++k) {
      const TouchedQuarters l = lists[k];
      FOR_EACH_TILE(l) {
        const int tile = y * tiles_x + x;
        ++counts[tile];
#if LAYERED
        nearest[tile] = l.near_z ? least(nearest[tile], l.near_z) : nearest[tile];
#endif
      }
    }
  }
  num_listed[chunk] = place - begin;
}

// Replace each tile's counts by the place in its list where each chunk begins. Give the length of the list and the end
// of its front layer: `thickness` (in perspective times z) behind the nearest splat.
kernel void bin_offsets(global int *tile_counts, global const int *tile_nearest, const int num_chunks,
                        const int num_tiles, const float thickness, global int *totals, global int *layer_ends)
{
  const int tile = get_global_id(0);
  int total = 0;
  for (int chunk = 0; chunk < num_chunks; ++chunk) {
    const int count = tile_counts[(long)chunk * num_tiles + tile];
    tile_counts[(long)chunk * num_tiles + tile] = total;
    total += count;
  }
  totals[tile] = total;
#if LAYERED
  int nearest = BEYOND_ALL;
  for (int chunk = 0; chunk < num_chunks; ++chunk)
    nearest = least(nearest, tile_nearest[(long)chunk * num_tiles + tile]);
  const float z = as_float(nearest);
  layer_ends[tile] = nearest == BEYOND_ALL ? BEYOND_ALL : as_int(ORTHOGRAPHIC ? z + thickness : z + z * thickness);
#endif
}

// The first and last quarter of a tile's side that lie in [first, last], two bits each.
static inline int key_of(int tile, int first, int last)
{
  return (first >> 2 == tile ? first & 3 : 0) | (last >> 2 == tile ? last & 3 : 3) << 2;
}

// Write the lists of the tiles [first_tile, last_tile).
kernel void bin_scatter(global const TouchedQuarters *lists, global const int *num_listed, const int spread,
                        const int chunk_size, global int *tile_offsets, global const int *tile_begin, global int *ids,
                        global const int *layer_ends, global int *occlusion_keys, const int tiles_x,
                        const int num_tiles, const int first_tile, const int last_tile)
{
  const int chunk = get_global_id(0) * spread % get_global_size(0);
  const int begin = chunk * chunk_size, end = begin + num_listed[chunk];
  global int *offsets = tile_offsets + (long)chunk * num_tiles;
  for (int i = begin; i < end; ++i) {
    const TouchedQuarters l = lists[i];
    FOR_EACH_TILE(l) {
      const int tile = y * tiles_x + x;
      if (tile < first_tile || tile >= last_tile) continue;
      const int place = tile_begin[tile - first_tile] + offsets[tile]++;
      ids[place] = l.id;
#if LAYERED
      const int near_z = l.near_z > layer_ends[tile] ? l.near_z : 0;
      occlusion_keys[place] =
          near_z | key_of(x, X_OF(l.first), X_OF(l.last)) | key_of(y, Y_OF(l.first), Y_OF(l.last)) << 4;
#endif
    }
  }
}
