// The projection pass: from the splats of the tile lists to the records of the raster passes, one record per entry.
//
// A work-item takes ENTRIES entries, LANES at a time.
//
// CENTER_LOW  1: centers have a low word, as float64 input in single precision has, 0: not
// LAYER       the entries to project (occlusion.h)
// POINT       1: a splat is drawn only in the square point of [BHZK05] section 3, 0: in all its pixels

#include "arithmetic/reals.h"
#include "arithmetic/exact.h"
#include "arithmetic/divide.h"
#include "arithmetic/vectors.h"
#include "arithmetic/twofloat.h"
#include "arithmetic/lanes.h"
#include "arithmetic/transpose.h"
#include "splat/eye.h"
#include "splat/extra.h"
#include "projection/record.h"
#include "projection/bounds.h"
#include "projection/ellipse.h"
#include "projection/extra_record.h"
#include "shading/gouraud.h"
#include "passes/occlusion.h"

// disc.h decides coverage per pixel, so bounds only have to be conservative. SLACK_PIXELS covers the rounding errors of
// the pixel offsets. The relative terms cover those of the coefficients, which grow with 1/cos(tilt).
#define SLACK_PIXELS R(0.0078125)
#define SLACK_SIZE R(3.8147e-6)
#define SLACK_TILT R(9.5367e-7)
#define EDGE_ON R(1.52587890625e-5)  // a splat with |cos(tilt)| up to this is edge-on (specification)
#define TILTED R(0.03125)             // a splat with |cos(tilt)| below this needs twice the precision
#define DEEP R(0.25)                 // a disc is deep if it reaches beyond this share of its center's z

static inline reals3 oriented_normal(constant View *view, reals3 g, reals3 center, reals *facing_dot)
{
  const reals3 n = normalize3(g);  // 0 where rounding makes nearly parallel tangents parallel
  *facing_dot = ORTHOGRAPHIC ? n.z : dot3(n, center);
  masks away = MASK(*facing_dot >= R(0.0)) & (masks)(view->facing == FLIP ? -1 : 0);
  reals3 flipped = {SELECT(n.x, -n.x, away), SELECT(n.y, -n.y, away), SELECT(n.z, -n.z, away)};
  return flipped;
}

// The coefficients of u, v and z over pixel offsets from the reference point p of the splat's plane (specification,
// Fragment): u = (u_x dx + u_y dy + u_1 den) / den with den = 1 + g_x dx + g_y dy.
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
// coefficients() in twice the precision, then rounded, in the lanes of `hard`. Near edge-on, or with the reference
// point far from the center, the cross products of plain precision lose the plane.
static inline void hard_coefficients(constant View *view, projected *s, eye_point tu, eye_point tv, eye_point p,
                                     masks hard)
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

// The raster coordinate of the reference point as a whole pixel and an offset from that pixel's center.
static inline void reference(twofloat point, twofloat z, twofloat focal, twofloat principal, reals *pixel,
                             reals *offset)
{
  twofloat image = ORTHOGRAPHIC ? point : two_divide(point, z);
  twofloat raster = two_add(two_multiply(focal, image), principal);  // principal counts from pixel 0's center
  *pixel = round_even(raster.hi);
  *offset = (raster.hi - *pixel) + raster.lo;
}

static inline projected project_splats(constant View *view, reals3 world, reals3 world_low, reals3 tu_world,
                                       reals3 tv_world)
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

  // The reference point of a splat is its center. If the center lies before the near plane, or the disc is deep, it is
  // the disc's farthest point instead: z = z_farthest / den with den >= 1 does not cancel.
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
  reals center_x = R(0.0), center_y = R(0.0);  // from the reference point to the projected center, pixels
  if (ANY(from_farthest & ~straddles)) {
    reals pixel_x, pixel_y, offset_x, offset_y;
    reference(c2.x, c2.z, TWO(fx), TWO(cx), &pixel_x, &offset_x);
    reference(c2.y, c2.z, TWO(fy), TWO(cy), &pixel_y, &offset_y);
    center_x = SELECT(R(0.0), (pixel_x - s.pixel_x) + (offset_x - s.offset_x), from_farthest);
    center_y = SELECT(R(0.0), (pixel_y - s.pixel_y) + (offset_y - s.offset_y), from_farthest);
  }
  s.u_x = SELECT(s.u_x, R(0.0), edge_on);
  s.u_y = SELECT(s.u_y, R(0.0), edge_on);
  s.u_1 = SELECT(s.u_1, R(2.0), edge_on);  // every pixel is outside the disc
  s.v_x = SELECT(s.v_x, R(0.0), edge_on);
  s.v_y = SELECT(s.v_y, R(0.0), edge_on);
  s.g_x = SELECT(s.g_x, R(0.0), edge_on);
  s.g_y = SELECT(s.g_y, R(0.0), edge_on);

  // The bounds of the disc.
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
  const reals lean = divide(distance, magnitude(facing_dot));  // 1 / cos(tilt)
  reals slack = size * (SLACK_SIZE + SLACK_TILT * lean) + SLACK_PIXELS;
  const real near = view->near - magnitude_of(view->near) * R(1e-5);
  const real far = view->far + magnitude_of(view->far) * R(1e-5);
  masks hittable = ~edge_on & MASK(c.z + reach >= near) & MASK(c.z - reach <= far);
#if ELLIPSE
  ellipse e = ellipse_of(view, c, tu, tv, g, reach);
  e.exists &= ~edge_on;
  extent shape_x = {center_x + e.x, square_root(e.xx)}, shape_y = {center_y + e.y, square_root(e.yy)};
  extent filtered_x, filtered_y;
  filter_ellipse(view, &e, center_x, center_y, &s.extra, &filtered_x, &filtered_y);
  slack = at_least(filtered_x.reach, filtered_y.reach) * (SLACK_SIZE + SLACK_TILT * lean) + SLACK_PIXELS;
  const bounds disc = bounds_of(shape_x, shape_y, slack, e.exists & ~culled);
  const bounds covered = bounds_of(filtered_x, filtered_y, slack, e.exists & ~culled);
#else
  const bounds disc = bounds_of(ex, ey, slack, hittable & ~culled), covered = disc;
#endif
  s.disc = pixels_of(view, &s, &disc);

  // The bounds of the pre-filter, about the projected center or about the center of the disc's bounds, or of the
  // parallelogram's.
  masks at_bounds = (masks)(view->prefilter_center ? -1 : 0);
#if !ORTHOGRAPHIC  // there all centers are the same
  if (view->prefilter_center == AT_PARALLELOGRAM) {
    ex.middle = center_x + corners_middle(divide(c.x, c.z), tu.x, tv.x, tu.z, tv.z, c.z, view->fx_hi);
    ey.middle = center_y + corners_middle(divide(c.y, c.z), tu.y, tv.y, tu.z, tv.z, c.z, view->fy_hi);
    exact = MASK(c.z - (magnitude(tu.z) + magnitude(tv.z)) > c.z * CLEAR);
  }
#endif
  masks filtered = MASK(c.z >= view->near) & MASK(c.z <= view->far) & (exact | ~at_bounds);
  filtered = filtered & (masks)(view->prefilter ? -1 : 0);
  s.prefilter_x = SELECT(center_x, ex.middle, at_bounds);
  s.prefilter_y = SELECT(center_y, ey.middle, at_bounds);
  const extent filter_x = {s.prefilter_x, view->prefilter_radius}, filter_y = {s.prefilter_y, view->prefilter_radius};
  const bounds drawn = around_both(covered, bounds_of(filter_x, filter_y, SLACK_PIXELS, filtered & ~culled));
  s.drawn = pixels_of(view, &s, &drawn);
#if POINT
  const reals longest = square_root(at_least(dot3(tu, tu), dot3(tv, tv)));
  const reals half_side = (ORTHOGRAPHIC ? longest : divide(longest, c.z)) * view->fy_hi;
  const reals drawn_half = view->prefilter ? at_least(half_side, (reals)view->prefilter_radius) : half_side;
  const masks drawable = MASK(c.z >= view->near) & MASK(c.z <= view->far);
  cut_to_point(view, &s, &s.disc, center_x, center_y, half_side, drawable);
  cut_to_point(view, &s, &s.drawn, center_x, center_y, drawn_half, drawable);
#endif
  s.prefilter_x = SELECT(NOWHERE, s.prefilter_x, filtered);
  s.prefilter_y = SELECT(NOWHERE, s.prefilter_y, filtered);

  s.near_z = at_least(least_depth(view, &s), view->near);
  s.near_z = SELECT(s.near_z, at_most(s.near_z, c.z), ELLIPSE ? (masks)-1 : filtered);  // rays that miss the disc
#if FILTER_DEPTH == FRONT_DEPTH
  s.near_z = SELECT(s.near_z, (reals)view->near, filtered);
#endif
#if EXTRA || SHADING == PER_SPLAT
  s.center = c;
  s.turned = MASK(facing_dot >= R(0.0)) & (masks)(view->facing == FLIP ? -1 : 0);
#endif
  return s;
}

// The lists lead to splats in any order, so caches miss. Both cache lines of a splat are therefore prefetched AHEAD
// entries early. (prefetch() does nothing in PoCL.)
#define AHEAD 24
#if ON_POCL
#define ASK_FOR_WORD(word) __builtin_prefetch((global const real *)(word))
#define ASK_FOR(splat) (ASK_FOR_WORD(splat), ASK_FOR_WORD((global const real *)((splat) + 1) - 1))
#else
#define ASK_FOR(splat)
#endif

#define LOW_WORD(lane, axis) center_low[3 * ids[entry[lane]] + axis]

// Write a record for each entry of the tile lists in LAYER. Entries of other layers get near_z = NaN: no pixels.
kernel void project(constant View *view, global const Splat *splats, global const real *center_low,
                    global const SplatExtra *extra_in, global const int *ids, global const int *occlusion_keys,
                    const int first, const int num_entries, global ProjectedSplat *records,
                    global SplatAttributes *attributes, global uint2 *boxes_drawn, global real *disc_near_z,
                    global real *near_z, global ProjectedExtra *extra SPLAT_LIGHT_PARAMETERS)
{
  const outputs to = {records, attributes, boxes_drawn, disc_near_z, near_z};
  const int begin = get_global_id(0) * ENTRIES, end = least(begin + ENTRIES, num_entries);
  ids += first;
#if LAYER != EVERY
  for (int i = begin; i < end; ++i) disc_near_z[i] = (real)NAN;
#endif
#if LAYER == FRONT
  for (int i = begin; i < end; ++i) near_z[i] = (real)NAN;
#endif
  int chosen[ENTRIES];
  const int num = entries_of_layer(occlusion_keys + first, begin, end, chosen);
  for (int i = 0; i < least(AHEAD, num); ++i) ASK_FOR(splats + ids[chosen[i]]);
  for (int i = 0; i < num; i += LANES) {
    int entry[LANES];
    for (int lane = 0; lane < LANES; ++lane) {
      entry[lane] = chosen[least(i + lane, num - 1)];
      ASK_FOR(splats + ids[chosen[least(i + lane + AHEAD, num - 1)]]);
    }
    LOAD_EIGHT(a, global, splats + ids[entry[lane]]);
    LOAD_EIGHT(b, global, &splats[ids[entry[lane]]].uy);  // words 4 to 11
    const reals3 world = {a.v[0], a.v[1], a.v[2]}, tu = {a.v[3], b.v[0], b.v[1]};
    const reals3 tv = {b.v[2], b.v[3], b.v[4]};
    reals3 color = {b.v[5], b.v[6], b.v[7]};
#if CENTER_LOW
    const reals3 world_low = {(reals)EACH_LANE(LOW_WORD, 0), (reals)EACH_LANE(LOW_WORD, 1),
                              (reals)EACH_LANE(LOW_WORD, 2)};
#else
    const reals3 world_low = world;
#endif
    projected s = project_splats(view, world, world_low, tu, tv);
#if EXTRA
    project_extras(view, &s, extra_in, ids, entry);
    store_extras(extra, entry, least(LANES, num - i), &s);
#endif
#if SHADING == PER_SPLAT
    color = gouraud_color(&s, color, shading, lights);
#endif
    store_records(&to, entry, least(LANES, num - i), &s, color);
  }
}
