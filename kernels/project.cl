// Project: splats -> the records that the raster passes stream, and how many each chunk puts into each tile.
// Centres may have a low word (CENTER_LOW 1: float64 input in single precision).
// A work-item takes one chunk of splats, LANES at a time, and writes the survivors compactly and in order.

#include "arithmetic.h"
#include "eye.h"

// Coverage is decided per pixel (splat.h); bounds only have to be safe. SLACK_PIXELS covers the rounding of the
// pixel offsets, the relative terms that of the coefficients, which grows with 1/cos(tilt).
#define SLACK_PIXELS R(0.0078125)
#define SLACK_SIZE R(3.8147e-6)
#define SLACK_TILT R(9.5367e-7)
#define EDGE_ON R(1.52587890625e-5)  // |cos(tilt)| at or below which a splat is edge-on (docs/specification.md)
#define TILTED R(0.03125)             // |cos(tilt)| below which a splat's coefficients need twice the precision
#define DEEP R(0.25)                 // a disc that reaches deeper than this share of its centre's z
#define CLEAR R(1e-4)                // a disc whose least z is below this share of its centre's has no finite bounds
#define NOWHERE R(1e9)               // a pre-filter centre that no pixel is near

#define KEEP 0
#define FLIP 1
#define CULL 2

// LANES numbers of one plane of a structure-of-arrays buffer.
static inline reals load(global const real *plane, int i)
{
#if LANES == 1
  return plane[i];
#else
  return PASTE(vload, LANES)(0, plane + i);
#endif
}

static inline reals3 load3(global const real *planes, int stride, int i)
{
  reals3 v = {load(planes, i), load(planes + stride, i), load(planes + 2 * (long)stride, i)};
  return v;
}

// How far the disc reaches from its projected centre along one image axis, in pixels: [middle - reach, middle + reach].
// The tangents to the projected conic, relative to the centre so that nothing cancels.
typedef struct {
  reals middle, reach;
} extent;

static inline extent perspective_extent(reals slope, reals u, reals v, reals uz, reals vz, reals w, real focal)
{
  reals pu = u - slope * uz, pv = v - slope * vz;
  reals pt = pu * uz + pv * vz;
  reals inverse = divide(focal, w);
  extent e = {-pt * inverse, square_root(pt * pt + (pu * pu + pv * pv) * w) * inverse};
  return e;
}

// The same for a disc that comes too near the eye plane for that: its box in eye space, cut at near.
static inline extent near_extent(reals center, reals reach, reals z_low, reals z_high, reals origin, real focal)
{
  reals low = center - reach, high = center + reach;
  low = divide(low, SELECT(z_low, z_high, MASK(low > R(0.0)))) * focal;
  high = divide(high, SELECT(z_high, z_low, MASK(high > R(0.0)))) * focal;
  reals slack = (magnitude(low) + magnitude(high)) * R(1e-5);
  extent e = {(low + high) * R(0.5) - origin, (high - low) * R(0.5) + slack};
  return e;
}

// Everything the raster passes need, LANES splats at once; the emitting loop reads it lane by lane.
typedef struct {
  reals pixel_x, pixel_y, offset_x, offset_y;
  reals u_x, u_y, u_1, v_x, v_y, v_1, g_x, g_y, z;
  reals normal_x, normal_y, normal_z, prefilter_x, prefilter_y, center_z;
  reals x_low, x_high, y_low, y_high;  // raster bounds relative to the pixel grid, clamped to the image
  masks visible;
} projected;

static inline reals3 oriented_normal(constant View *view, reals3 g, reals3 center, reals *facing_dot)
{
  reals3 n = scale3(g, divide(R(1.0), square_root(dot3(g, g))));
  *facing_dot = ORTHOGRAPHIC ? n.z : dot3(n, center);
  masks away = MASK(*facing_dot >= R(0.0)) & (masks)(view->facing == FLIP ? -1 : 0);
  reals3 flipped = {SELECT(n.x, -n.x, away), SELECT(n.y, -n.y, away), SELECT(n.z, -n.z, away)};
  return flipped;
}

// The coefficients of u, v and z over pixel offsets from the reference point p of the splat's plane
// (docs/specification.md, Fragment): u = (u_x dx + u_y dy + u_1 den) / den with den = 1 + g_x dx + g_y dy.
static inline void coefficients(constant View *view, projected *s, reals3 tu, reals3 tv, reals3 g, reals3 p)
{
#if ORTHOGRAPHIC
  reals inverse = divide(R(1.0), g.z);
  reals sx = divide(inverse, view->fx_hi), sy = divide(inverse, view->fy_hi);
  s->u_x = tv.y * sx;
  s->u_y = -tv.x * sy;
  s->v_x = -tu.y * sx;
  s->v_y = tu.x * sy;
  s->g_x = -g.x * sx;  // here the slope of z itself
  s->g_y = -g.y * sy;
#else
  reals3 a = cross3(tv, p), b = cross3(p, tu);
  reals inverse = divide(p.z, dot3(g, p));
  reals sx = divide(inverse, view->fx_hi), sy = divide(inverse, view->fy_hi);
  s->g_x = g.x * sx;
  s->g_y = g.y * sy;
  s->u_x = a.x * sx + s->u_1 * s->g_x;
  s->u_y = a.y * sy + s->u_1 * s->g_y;
  s->v_x = b.x * sx + s->v_1 * s->g_x;
  s->v_y = b.y * sy + s->v_1 * s->g_y;
#endif
  s->z = p.z;
}

#if !ORTHOGRAPHIC
// coefficients() to twice the precision and then rounded, in the lanes of `hard`: near edge-on, or where the
// reference point is far from the centre, the float32 cross products lose the plane.
static inline void hard_coefficients(constant View *view, projected *s, eye_point tu, eye_point tv, eye_point p, masks hard)
{
  eye_point a = two_cross(tv, p), b = two_cross(p, tu), g = two_cross(tu, tv);
  twofloat gp = two_add(two_add(two_multiply(g.x, p.x), two_multiply(g.y, p.y)), two_multiply(g.z, p.z));
  twofloat inverse = two_divide(p.z, gp);
  const reals fx = view->fx_hi, fy = view->fy_hi;
  s->g_x = SELECT(s->g_x, divide(two_multiply(g.x, inverse).hi, fx), hard);
  s->g_y = SELECT(s->g_y, divide(two_multiply(g.y, inverse).hi, fy), hard);
  s->u_x = SELECT(s->u_x, divide(two_multiply(a.x, inverse).hi, fx) + s->u_1 * s->g_x, hard);
  s->u_y = SELECT(s->u_y, divide(two_multiply(a.y, inverse).hi, fy) + s->u_1 * s->g_y, hard);
  s->v_x = SELECT(s->v_x, divide(two_multiply(b.x, inverse).hi, fx) + s->v_1 * s->g_x, hard);
  s->v_y = SELECT(s->v_y, divide(two_multiply(b.y, inverse).hi, fy) + s->v_1 * s->g_y, hard);
}
#endif

// Raster coordinate of the reference point as a whole pixel and an offset from that pixel's centre.
static inline void reference(twofloat point, twofloat z, twofloat focal, twofloat principal, reals *pixel, reals *offset)
{
  twofloat image = ORTHOGRAPHIC ? point : two_divide(point, z);
  twofloat raster = two_add(two_multiply(focal, image), principal);  // principal is given from pixel 0's centre
  *pixel = round_even(raster.hi);
  *offset = (raster.hi - *pixel) + raster.lo;
}

static inline projected project_splats(constant View *view, reals3 world, reals3 world_low, reals3 tu_world, reals3 tv_world)
{
  eye_point c2 = eye_from_world(view, world, world_low);
  reals3 c = {c2.x.hi, c2.y.hi, c2.z.hi};
  reals3 tu = rotate(view, tu_world), tv = rotate(view, tv_world);
  reals3 g = cross3(tu, tv);
  reals reach = square_root(tu.z * tu.z + tv.z * tv.z);
  projected s;

  reals facing_dot;
  reals3 n = oriented_normal(view, g, c, &facing_dot);
  s.normal_x = n.x;
  s.normal_y = n.y;
  s.normal_z = n.z;
  reals distance = ORTHOGRAPHIC ? (reals)R(1.0) : square_root(dot3(c, c));
  masks edge_on = MASK(magnitude(facing_dot) <= distance * EDGE_ON);
  masks culled = MASK(facing_dot >= R(0.0)) & (masks)(view->facing == CULL ? -1 : 0);

  // A splat is described from its centre; one whose centre is not visible, or much nearer than its farthest point,
  // from that: z = z_farthest / den with den >= 1 does not cancel.
  masks straddles = ORTHOGRAPHIC ? (masks)0 : MASK(c.z < view->near);
  masks from_farthest = ORTHOGRAPHIC ? (masks)0 : straddles | MASK(reach > c.z * DEEP);
  s.u_1 = SELECT(R(0.0), divide(tu.z, reach), from_farthest);
  s.v_1 = SELECT(R(0.0), divide(tv.z, reach), from_farthest);
  eye_point p2 = c2;
#if !ORTHOGRAPHIC
  const masks hard = ~culled & (from_farthest | MASK(magnitude(facing_dot) < distance * TILTED));
  const int any_hard = ANY(hard);
  eye_point tu2, tv2;
  if (any_hard) {
    tu2 = rotate_twofloat(view, tu_world);
    tv2 = rotate_twofloat(view, tv_world);
    p2.x = two_step(c2.x, s.u_1, tu2.x, s.v_1, tv2.x);
    p2.y = two_step(c2.y, s.u_1, tu2.y, s.v_1, tv2.y);
    p2.z = two_step(c2.z, s.u_1, tu2.z, s.v_1, tv2.z);
  }
#endif
  reals3 p = {p2.x.hi, p2.y.hi, p2.z.hi};
  reference(p2.x, p2.z, TWO(fx), TWO(cx), &s.pixel_x, &s.offset_x);
  reference(p2.y, p2.z, TWO(fy), TWO(cy), &s.pixel_y, &s.offset_y);
  coefficients(view, &s, tu, tv, g, p);
#if !ORTHOGRAPHIC
  if (any_hard) hard_coefficients(view, &s, tu2, tv2, p2, hard);
#endif
  s.center_z = c.z;
  reals center_x = R(0.0), center_y = R(0.0);  // the projected centre from the reference point, pixels
  if (ANY(from_farthest & ~straddles)) {
    reals pixel_x, pixel_y, offset_x, offset_y;
    reference(c2.x, c2.z, TWO(fx), TWO(cx), &pixel_x, &offset_x);
    reference(c2.y, c2.z, TWO(fy), TWO(cy), &pixel_y, &offset_y);
    center_x = SELECT(R(0.0), (pixel_x - s.pixel_x) + (offset_x - s.offset_x), from_farthest);
    center_y = SELECT(R(0.0), (pixel_y - s.pixel_y) + (offset_y - s.offset_y), from_farthest);
  }
  s.u_x = SELECT(s.u_x, R(0.0), edge_on);
  s.u_y = SELECT(s.u_y, R(0.0), edge_on);
  s.u_1 = SELECT(s.u_1, R(2.0), edge_on);  // outside the disc everywhere
  s.v_x = SELECT(s.v_x, R(0.0), edge_on);
  s.v_y = SELECT(s.v_y, R(0.0), edge_on);
  s.g_x = SELECT(s.g_x, R(0.0), edge_on);
  s.g_y = SELECT(s.g_y, R(0.0), edge_on);

  // Bounds of the disc.
#if ORTHOGRAPHIC
  masks exact = (masks)-1;
  extent ex = {(reals)R(0.0), square_root(tu.x * tu.x + tv.x * tv.x) * view->fx_hi};
  extent ey = {(reals)R(0.0), square_root(tu.y * tu.y + tv.y * tv.y) * view->fy_hi};
#else
  masks exact = ~straddles & MASK(c.z - reach > c.z * CLEAR);
  reals w = (c.z - reach) * (c.z + reach);
  extent ex = perspective_extent(divide(c.x, c.z), tu.x, tv.x, tu.z, tv.z, w, view->fx_hi);
  extent ey = perspective_extent(divide(c.y, c.z), tu.y, tv.y, tu.z, tv.z, w, view->fy_hi);
  ex.middle = ex.middle + center_x;
  ey.middle = ey.middle + center_y;
  if (ANY(~exact)) {
    reals z_low = at_least(c.z - reach, view->near), z_high = c.z + reach;
    reals x_origin = s.pixel_x - view->cx_hi + s.offset_x, y_origin = s.pixel_y - view->cy_hi + s.offset_y;
    extent nx = near_extent(c.x, square_root(tu.x * tu.x + tv.x * tv.x), z_low, z_high, x_origin, view->fx_hi);
    extent ny = near_extent(c.y, square_root(tu.y * tu.y + tv.y * tv.y), z_low, z_high, y_origin, view->fy_hi);
    ex.middle = SELECT(nx.middle, ex.middle, exact);
    ex.reach = SELECT(nx.reach, ex.reach, exact);
    ey.middle = SELECT(ny.middle, ey.middle, exact);
    ey.reach = SELECT(ny.reach, ey.reach, exact);
  }
#endif
  reals size = SELECT(ey.reach, ex.reach, MASK(ex.reach > ey.reach));
  reals slack = size * (SLACK_SIZE + SLACK_TILT * divide(distance, magnitude(facing_dot))) + SLACK_PIXELS;
  masks hittable = ~edge_on & MASK(c.z + reach >= view->near * R(0.99999)) & MASK(c.z - reach <= view->far * R(1.00001));
  reals x_low = SELECT(NOWHERE, ex.middle - ex.reach - slack, hittable);
  reals x_high = SELECT(-NOWHERE, ex.middle + ex.reach + slack, hittable);
  reals y_low = SELECT(NOWHERE, ey.middle - ey.reach - slack, hittable);
  reals y_high = SELECT(-NOWHERE, ey.middle + ey.reach + slack, hittable);

  // The pre-filter's disc around the projected centre, or around the centre of those bounds.
  masks at_bounds = (masks)(view->prefilter_at_bounds ? -1 : 0);
  masks filtered = MASK(c.z >= view->near) & MASK(c.z <= view->far) & (exact | ~at_bounds);
  filtered = filtered & (masks)(view->prefilter ? -1 : 0);
  s.prefilter_x = SELECT(center_x, ex.middle, at_bounds);
  s.prefilter_y = SELECT(center_y, ey.middle, at_bounds);
  reals radius = SELECT(-R(2.0) * NOWHERE, (reals)(view->prefilter_radius + SLACK_PIXELS), filtered);
  x_low = at_most(x_low, s.prefilter_x - radius);
  x_high = at_least(x_high, s.prefilter_x + radius);
  y_low = at_most(y_low, s.prefilter_y - radius);
  y_high = at_least(y_high, s.prefilter_y + radius);
  s.prefilter_x = SELECT(NOWHERE, s.prefilter_x, filtered);
  s.prefilter_y = SELECT(NOWHERE, s.prefilter_y, filtered);

  // To pixels; a reference far outside the image rounds coarsely.
  reals coarse_x = magnitude(s.pixel_x) * R(2.4e-7), coarse_y = magnitude(s.pixel_y) * R(2.4e-7);
  reals right = (reals)(real)view->width, bottom = (reals)(real)view->height;
  s.x_low = at_most(at_least(s.pixel_x + (s.offset_x + x_low - coarse_x), R(0.0)), right);
  s.y_low = at_most(at_least(s.pixel_y + (s.offset_y + y_low - coarse_y), R(0.0)), bottom);
  s.x_high = at_least(at_most(s.pixel_x + (s.offset_x + x_high + coarse_x), right - R(1.0)), R(-1.0));
  s.y_high = at_least(at_most(s.pixel_y + (s.offset_y + y_high + coarse_y), bottom - R(1.0)), R(-1.0));
  s.visible = ~culled & (hittable | filtered) & MASK(s.x_low <= s.x_high) & MASK(s.y_low <= s.y_high);
  return s;
}

#define LANE(name) (((const real *)&s.name)[lane])

kernel void project(constant View *view, global const real *center, global const real *center_low,
                    global const real *tangent_u, global const real *tangent_v, global const real *color,
                    const int num_splats, const int stride, const int chunk_size, global ProjectedSplat *records,
                    global SplatAttributes *attributes, global int *num_survivors, global int *tile_counts,
                    const int tiles_x, const int num_tiles)
{
  const int chunk = get_global_id(0);
  const int begin = chunk * chunk_size, end = min(begin + chunk_size, num_splats);
  global int *counts = tile_counts + (long)chunk * num_tiles;
  for (int tile = 0; tile < num_tiles; ++tile) counts[tile] = 0;
  int survivors = begin;
  for (int i = begin; i < end; i += LANES) {
    const reals3 world = load3(center, stride, i);
    const reals3 world_low = CENTER_LOW ? load3(center_low, stride, i) : world;
    projected s = project_splats(view, world, world_low, load3(tangent_u, stride, i), load3(tangent_v, stride, i));
    if (!ANY(s.visible)) continue;
    for (int lane = 0; lane < LANES && i + lane < end; ++lane) {
      if (!((const bits *)&s.visible)[lane]) continue;
      const real x_low = LANE(x_low), y_low = LANE(y_low);
      const int x_min = (int)x_low + ((real)(int)x_low < x_low), x_max = (int)(LANE(x_high) + R(1.0)) - 1;
      const int y_min = (int)y_low + ((real)(int)y_low < y_low), y_max = (int)(LANE(y_high) + R(1.0)) - 1;
      if (x_min > x_max || y_min > y_max) continue;
      records[survivors] = (ProjectedSplat){
          LANE(pixel_x), LANE(pixel_y), LANE(offset_x), LANE(offset_y), LANE(u_x), LANE(u_y), LANE(u_1),
          LANE(v_x), LANE(v_y), LANE(v_1), LANE(g_x), LANE(g_y), LANE(z), i + lane, x_min, y_min, x_max, y_max};
      attributes[survivors] = (SplatAttributes){
          color[i + lane], color[stride + i + lane], color[2 * (long)stride + i + lane],
          LANE(normal_x), LANE(normal_y), LANE(normal_z), LANE(prefilter_x), LANE(prefilter_y), LANE(center_z)};
      ++survivors;
      for (int ty = y_min / TILE; ty <= y_max / TILE; ++ty)
        for (int tx = x_min / TILE; tx <= x_max / TILE; ++tx) ++counts[ty * tiles_x + tx];
    }
  }
  num_survivors[chunk] = survivors - begin;
}
