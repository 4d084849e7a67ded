// The nearby splats: those that touch or nearly touch each tile, with the terms of the oracle's equations in double
// precision.
//
// First each splat's widened bounds and a count of each tile's splats, then the tiles' lists (a stable counting sort),
// then a record for each entry. A work-item takes a chunk of splats, or of records, LANES at a time.
//
// ENTRIES  records of a work-item
// VALUES   numbers of each splat: its color, its normal and the margin of the normal's sign

#include "arithmetic/reals.h"
#include "arithmetic/divide.h"
#include "arithmetic/vectors.h"
#include "arithmetic/lanes.h"
#include "splat/eye.h"
#include "evidence/margin.h"

typedef double4 real4;

#define EDGE_ON_COSINE R(1.52587890625e-5)  // a disc with |cos| up to this is not intersected
#define CLEAR_SHARE R(1e-4)  // a disc whose least z is below this share of its center's has infinite bounds
#define CENTER_ERROR R(2.0)  // of a projected center, 2^-24 pixels
#define WIDENED_PIXELS R(0.02)  // added around the bounds, so that near misses are pairs too

#define WORLD_REALS 12
#define WORLD_REAL(lane, field) world[(long)WORLD_REALS * place[lane] + field]
#define LOAD3(first) ((reals3){(reals)EACH_LANE(WORLD_REAL, first), (reals)EACH_LANE(WORLD_REAL, first + 1), \
                               (reals)EACH_LANE(WORLD_REAL, first + 2)})
#define ALL(condition) ((masks)((condition) ? -1 : 0))

// LANES splats in eye space.
typedef struct {
  reals3 center, tu, tv, g, normal;  // g = t_u x t_v; the normal after View.facing
  reals reach, distance;             // half the disc's range of z; from the eye to the center
  reals cosine, kappa;               // |cos| of the angle between normal and line to the center; condition
  reals edge_margin, facing_margin;  // signed
  masks culled;
} splats;

static inline splats splats_at(constant View *view, global const real *world, const int *place)
{
  splats s;
  s.center = add3(rotate(view, LOAD3(0)), (reals3){view->t0_hi, view->t1_hi, view->t2_hi});
  s.tu = rotate(view, LOAD3(3));
  s.tv = rotate(view, LOAD3(6));
  s.g = cross3(s.tu, s.tv);
  s.reach = square_root(square(s.tu.z) + square(s.tv.z));
  s.distance = square_root(dot3(s.center, s.center));
  const reals area = square_root(dot3(s.g, s.g)), u2 = dot3(s.tu, s.tu), v2 = dot3(s.tv, s.tv);
  s.normal = scale3(s.g, divide(R(1.0), area));
  const reals cosine = ORTHOGRAPHIC ? s.normal.z : divide(dot3(s.normal, s.center), s.distance);
  const reals unit = UNIT * divide(R(4.0) * square_root(u2) * square_root(v2), area);
  s.cosine = magnitude(cosine);
  s.kappa = divide(divide(most_of(u2, v2), area), s.cosine);
  s.edge_margin = divide(s.cosine - EDGE_ON_COSINE, unit);
  const masks away = MASK(cosine >= R(0.0));
  s.culled = away & ALL(view->facing == CULL);
  s.facing_margin = divide(s.cosine, unit);
  s.facing_margin = SELECT(s.facing_margin, -s.facing_margin, s.culled);
  s.facing_margin = SELECT(s.facing_margin, INFINITE, ALL(view->facing == KEEP));
  const reals turn = SELECT((reals)R(1.0), (reals)R(-1.0), away & ALL(view->facing == FLIP));
  s.normal = scale3(s.normal, turn);
  return s;
}

// Whether the whole disc is outside [near, far], by more than a thousandth of its distance.
static inline masks out_of_range(constant View *view, const splats *s)
{
  const reals clearly = R(1e-3) * (s->distance + s->reach);
  return MASK(s->center.z + s->reach + clearly < view->near) | MASK(s->center.z - s->reach - clearly > view->far);
}

// Raster bounds, counted from the center of pixel 0.
typedef struct {
  reals low, high;
} raster_bounds;

// The bounds of whole discs along one axis; infinite if a disc comes near the eye plane. The plane x = s z is tangent
// to the disc if |t_x - s t_z|^2 = (c_x - s c_z)^2, a quadratic equation in s.
static inline raster_bounds disc_extent(const splats *s, reals c, reals u, reals v, real focal, real principal)
{
  raster_bounds e;
#if ORTHOGRAPHIC
  const reals half_width = square_root(u * u + v * v);
  e.low = c - half_width;
  e.high = c + half_width;
#else
  const reals z = s->center.z, uz = s->tu.z, vz = s->tv.z;
  const reals p = (uz * uz + vz * vz) - z * z, q = (u * uz + v * vz) - c * z;
  const reals root2 = (square(z * u - c * uz) + square(z * v - c * vz)) - square(u * vz - v * uz);
  const reals root = square_root(at_least(root2, R(0.0)));
  const masks clear = MASK(z - s->reach > CLEAR_SHARE * z);
  e.low = SELECT(-INFINITE, divide(q + root, p), clear);
  e.high = SELECT(INFINITE, divide(q - root, p), clear);
#endif
  e.low = e.low * focal + principal;
  e.high = e.high * focal + principal;
  return e;
}

static inline raster_bounds disc_x(constant View *view, const splats *s)
{
  return disc_extent(s, s->center.x, s->tu.x, s->tv.x, view->fx_hi, view->cx_hi);
}

static inline raster_bounds disc_y(constant View *view, const splats *s)
{
  return disc_extent(s, s->center.y, s->tu.y, s->tv.y, view->fy_hi, view->cy_hi);
}

// The pre-filter's center, from the center of pixel 0, and its error in 2^-24 pixels. `margin` is the signed margin of
// the condition for a pre-filter: the center's z is in [near, far].
typedef struct {
  reals x, y, error, margin;
} filter_centers;

static inline reals center_x(const splats *s) { return ORTHOGRAPHIC ? s->center.x : divide(s->center.x, s->center.z); }
static inline reals center_y(const splats *s) { return ORTHOGRAPHIC ? s->center.y : divide(s->center.y, s->center.z); }

// The middle of the bounds of the corners c +- t_u +- t_v along one axis, from the center of pixel 0, and the error of
// each corner: its terms divided by its z.
static inline reals parallelogram_middle(const splats *s, reals c, reals u, reals v, real focal, real principal,
                                         reals *error)
{
  const reals z = s->center.z, uz = s->tu.z, vz = s->tv.z, deep = magnitude(uz) + magnitude(vz);
  const reals terms = (magnitude(u) + magnitude(v)) * focal;
#if ORTHOGRAPHIC
  *error = terms;
  return c * focal + principal;
#else
  const reals a = divide(c + u + v, z + uz + vz), b = divide(c - u - v, z - uz - vz);
  const reals d = divide(c + u - v, z + uz - vz), e = divide(c - u + v, z - uz + vz);
  const reals low = least_of(least_of(a, b), least_of(d, e)), high = most_of(most_of(a, b), most_of(d, e));
  const reals lean = magnitude(divide(c, z)) * deep * focal;
  *error = divide(divide((terms + lean) * (z + deep), z - deep), z - deep);
  return (low + high) * (R(0.5) * focal) + principal;
#endif
}

static inline filter_centers filter_center_of(constant View *view, const splats *s, raster_bounds ex, raster_bounds ey)
{
  const reals z = s->center.z, depth_error = UNIT * (magnitude(z) + TINY);
  filter_centers p = {center_x(s) * view->fx_hi + view->cx_hi, center_y(s) * view->fy_hi + view->cy_hi, CENTER_ERROR,
                  divide(least_of(z - view->near, view->far - z), depth_error)};
  if (view->prefilter_center == AT_PARALLELOGRAM) {
    reals error_x, error_y;
    const masks clear = ALL(ORTHOGRAPHIC) | MASK(z - (magnitude(s->tu.z) + magnitude(s->tv.z)) > CLEAR_SHARE * z);
    p.x = parallelogram_middle(s, s->center.x, s->tu.x, s->tv.x, view->fx_hi, view->cx_hi, &error_x);
    p.y = parallelogram_middle(s, s->center.y, s->tu.y, s->tv.y, view->fy_hi, view->cy_hi, &error_y);
    p.x = SELECT((reals)(real)NAN, p.x, clear);
    p.error = SELECT(INFINITE, p.error + (error_x + error_y), clear);
  } else if (view->prefilter_center == AT_BOUNDS) {
    const reals x = (ex.low + ex.high) * R(0.5), y = (ey.low + ey.high) * R(0.5);
    const reals z2 = square(z), reach2 = square(s->reach);
    const reals moved = magnitude(x - p.x) + magnitude(y - p.y);
    p.error = p.error + divide(moved * (z2 + reach2), magnitude(z2 - reach2));
    p.x = x;
    p.y = y;
  }
  const masks none = MASK(p.x != p.x) | MASK(p.y != p.y) | ALL(!view->prefilter);
  p.margin = SELECT(p.margin, -INFINITE, none);
  return p;
}

// The bounds of disc and pre-filter together, widened to include every decision within MAX_MARGIN.
static inline raster_bounds widened(raster_bounds disc, reals filter, reals radius, reals slack, masks filtered)
{
  raster_bounds e = {SELECT(disc.low, least_of(disc.low, filter - radius), filtered) - slack,
              SELECT(disc.high, most_of(disc.high, filter + radius), filtered) + slack};
  return e;
}

// The first and last pixel of the bounds in an image of `size` pixels.
static inline raster_bounds in_image(raster_bounds e, real size)
{
  raster_bounds c = {round_up(at_most(at_least(e.low, R(0.0)), size)),
              round_down(at_least(at_most(e.high, size - R(1.0)), R(-1.0)))};
  return c;
}

// Give each splat's first and last x and y (x_first > x_last: none), and the number of each chunk's splats in each
// tile.
kernel void nearby_count(constant View *view, global const real *world, const int num_splats, const int chunk_size,
                         global short4 *bounds, global int *tile_counts, const int tiles_x, const int num_tiles)
{
  const int chunk = get_global_id(0);
  const int begin = chunk * chunk_size, end = least(begin + chunk_size, num_splats);
  global int *counts = tile_counts + (long)chunk * num_tiles;
  for (int tile = 0; tile < num_tiles; ++tile) counts[tile] = 0;
  for (int i = begin; i < end; i += LANES) {
    int place[LANES];
    for (int lane = 0; lane < LANES; ++lane) place[lane] = least(i + lane, end - 1);
    const splats s = splats_at(view, world, place);
    raster_bounds x = disc_x(view, &s), y = disc_y(view, &s);
    const filter_centers p = filter_center_of(view, &s, x, y);
    const masks nothing = out_of_range(view, &s);
    const reals size = SELECT(most_of(x.high - x.low, y.high - y.low), (reals)R(0.0), nothing);
    const reals shares = at_most((MAX_MARGIN * UNIT) * (R(8.0) + R(4.0) * s.kappa), R(100.0));
    const reals slack = WIDENED_PIXELS + size * shares;
    x = (raster_bounds){SELECT(x.low, INFINITE, nothing), SELECT(x.high, -INFINITE, nothing)};
    y = (raster_bounds){SELECT(y.low, INFINITE, nothing), SELECT(y.high, -INFINITE, nothing)};
    const masks filtered = MASK(p.margin > -MAX_MARGIN);
    const masks hopeless = s.culled & MASK(s.facing_margin < -MAX_MARGIN);
    x = widened(x, p.x, view->prefilter_radius, slack, filtered);
    y = widened(y, p.y, view->prefilter_radius, slack, filtered);
    x.low = SELECT(x.low, INFINITE, hopeless);
    x = in_image(x, (real)view->width);
    y = in_image(y, (real)view->height);
    for (int lane = 0; lane < LANES && i + lane < end; ++lane) {
      const short4 b = {LANE_OF(x.low, lane), LANE_OF(y.low, lane), LANE_OF(x.high, lane), LANE_OF(y.high, lane)};
      const int some = b.x <= b.z && b.y <= b.w;
      bounds[i + lane] = some ? b : (short4)(1, 1, 0, 0);
      if (!some) continue;
      for (int ty = b.y / TILE; ty <= b.w / TILE; ++ty)
        for (int tx = b.x / TILE; tx <= b.z / TILE; ++tx) ++counts[ty * tiles_x + tx];
    }
  }
}

// Write each splat and its bounds, 104 bytes, into the lists of the tiles in [first_tile, last_tile) that it touches.
// nearby_records streams these lists, which is twice as fast as fetching splats by index.
kernel void nearby_list(global const real4 *world, global const short4 *bounds, const int num_splats,
                        const int chunk_size, global int *tile_offsets, global real4 *listed,
                        global short4 *listed_bounds, const int tiles_x, const int num_tiles, const int first_tile,
                        const int last_tile)
{
  const int chunk = get_global_id(0);
  const int begin = chunk * chunk_size, end = least(begin + chunk_size, num_splats);
  global int *offsets = tile_offsets + (long)chunk * num_tiles;
  for (int i = begin; i < end; ++i) {
    const short4 b = bounds[i];
    if (b.x > b.z) continue;
    for (int ty = b.y / TILE; ty <= b.w / TILE; ++ty)
      for (int tx = b.x / TILE; tx <= b.z / TILE; ++tx) {
        const int tile = ty * tiles_x + tx;
        if (tile < first_tile || tile >= last_tile) continue;
        const int place = offsets[tile]++;
        for (int k = 0; k < 3; ++k) listed[3L * place + k] = world[3L * i + k];
        listed_bounds[place] = b;
      }
  }
}

// The linear forms of u = U.s / D.s, v = V.s / D.s and z = Z.s / D.s at the pixel s = ((x-cx)/fx, (y-cy)/fy, 1). Their
// sign makes D.s positive in front of the eye. One of Z and D has a single term, `h`; the other is g: D in perspective,
// Z in an orthographic projection.
typedef struct {
  reals3 u, v, g;
  reals h, center;  // |D.s| at the projected center
} forms;

static inline forms forms_of(const splats *s)
{
  const reals3 a = cross3(s->tv, s->center), b = cross3(s->center, s->tu);
  const reals volume = dot3(s->center, s->g);
#if ORTHOGRAPHIC
  const reals signed_by = s->g.z;
  forms f = {{s->tv.y, -s->tv.x, a.z}, {-s->tu.y, s->tu.x, b.z}, {-s->g.x, -s->g.y, volume}, s->g.z, magnitude(s->g.z)};
#else
  const reals signed_by = volume;
  forms f = {a, b, s->g, volume, magnitude(divide(volume, s->center.z))};
#endif
  const reals sign = SELECT(SELECT((reals)R(1.0), (reals)R(-1.0), MASK(signed_by < R(0.0))), (reals)R(0.0),
                            MASK(signed_by == R(0.0)));
  f.u = scale3(f.u, sign);
  f.v = scale3(f.v, sign);
  f.g = scale3(f.g, sign);
  f.h = f.h * sign;
  return f;
}

// A lower bound of the depths of all possible fragments: z at r = 2 less a thousandth, which is far above the errors
// within MAX_MARGIN; these grow with kappa. A disc that is not well in front of the eye has no bound.
static inline reals nearest_z(const splats *s)
{
  const reals z = s->center.z;
  const reals near_z = z - R(2.0) * s->reach - z * (R(1e-3) * (R(1.0) + s->kappa));
  return SELECT(-INFINITE, near_z, MASK(near_z > z * R(0.5)) & ALL(!ORTHOGRAPHIC));
}

#define L(value) LANE_OF(value, lane)

// Write a record for each entry of the lists from `first` on, and the values of its fragments.
kernel void nearby_records(constant View *view, global const real *world, global const short4 *bounds, const int first,
                           const int num_entries, global NearbySplat *records, global real *values)
{
  const int begin = get_global_id(0) * ENTRIES, end = least(begin + ENTRIES, num_entries);
  for (int i = begin; i < end; i += LANES) {
    int place[LANES];
    for (int lane = 0; lane < LANES; ++lane) place[lane] = first + least(i + lane, end - 1);
    const splats s = splats_at(view, world, place);
    raster_bounds x = {(reals)R(0.0), (reals)R(0.0)}, y = x;
    if (view->prefilter_center == AT_BOUNDS) {
      x = disc_x(view, &s);
      y = disc_y(view, &s);
    }
    const filter_centers p = filter_center_of(view, &s, x, y);
    const forms f = forms_of(&s);
    const reals cx = center_x(&s), cy = center_y(&s), steep = R(1.0) + s.kappa;
    const reals usable = SELECT(least_of(s.edge_margin, s.facing_margin), -INFINITE, out_of_range(view, &s));
    const reals near_z = nearest_z(&s);
    const reals filter_margin = least_of(s.facing_margin, p.margin);
    for (int lane = 0; lane < LANES && i + lane < end; ++lane) {
      const short4 b = bounds[place[lane]];
      records[i + lane] = (NearbySplat){
          L(f.u.x), L(f.u.y), L(f.u.z), L(f.v.x), L(f.v.y), L(f.v.z), L(f.g.x), L(f.g.y), L(f.g.z), L(f.h),
          L(cx), L(cy), L(f.center), L(steep), L(usable), L(s.center.z), L(near_z), L(p.x), L(p.y), L(p.error),
          L(filter_margin), b.x, b.y, b.z, b.w};
      global real *value = values + (long)VALUES * (i + lane);
      for (int k = 0; k < 3; ++k) value[k] = world[(long)WORLD_REALS * place[lane] + 9 + k];
      value[3] = L(s.normal.x);
      value[4] = L(s.normal.y);
      value[5] = L(s.normal.z);
      value[6] = L(s.facing_margin);
    }
  }
}
