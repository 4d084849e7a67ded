// The probe: the passes at one pixel, splat by splat. It calls the functions of the passes, so it has the frame's bits.

#include "arithmetic/reals.h"
#include "arithmetic/divide.h"
#include "splat/disc.h"
#include "splat/extra.h"
#include "splat/fragment.h"
#include "passes/contribution.h"

// Bits of ProbedSplat.state.
#define STATE_HIT 1        // the disc is hit
#define STATE_OUT 2        // the disc is hit, but outside near..far
#define STATE_EXISTS 4     // the disc or the pre-filter has a fragment
#define STATE_ACCEPTED 8   // the fragment is accumulated
#define STATE_EDGE_ON 16
#define STATE_CUT 32         // a clip line cuts the fragment off
#define FILTERED R(1e8)  // without a pre-filter, its center is beyond this (bounds.h, NOWHERE)

// One record and its intersection at the pixel.
typedef struct {
  ProjectedSplat record;
  discs disc;
  prefilters prefilter;
  extras extra;
  hit hit;
} probed;

static inline probed probe_entry(global const ProjectedSplat *records, global const ProjectedExtra *extra,
                                 global const SplatAttributes *attributes, int i, int x, int y)
{
  probed p;
  p.record = records[i];
  const SplatAttributes own = attributes[i];
  p.disc = disc_of(&p.record);
  p.prefilter = prefilter_of(&p.record, &own);
  load_one_extra(&p.extra, extra, attributes, i);
  p.hit = intersect(&p.disc, (reals)x, (reals)y);
  return p;
}

// r2^2 of the pre-filter, or r^2 of an elliptic footprint, after EWA's filter if any.
static inline real filter_radius2(const probed *p, real inverse_radius2)
{
  real r2 = (real)INFINITY;
#if ELLIPSE
  r2 = ellipse_radius2(&p->extra, PREFILTER == EWA ? &p->extra.filtered : &p->extra.shape, &p->hit);
#endif
#if !ELLIPSE || PREFILTER == MIN_FILTER
  const real screen_r2 = screen_radius2(&p->prefilter, &p->hit, inverse_radius2);
  r2 = screen_r2 < r2 ? screen_r2 : r2;
#endif
  return r2;
}

// Find each chunk's splats whose disc, footprint or pre-filter, enlarged `reach` times, covers the pixel.
kernel void probe_select(global const ProjectedSplat *records, global const ProjectedExtra *extra,
                         global const SplatAttributes *attributes, global const real *near_z, global const int *ids,
                         const int num_records, const int chunk_size, const int x, const int y, const real reach,
                         const real inverse_radius2, global int *found, global int *num_found)
{
  const int begin = get_global_id(0) * chunk_size, end = least(begin + chunk_size, num_records);
  int place = begin;
  for (int i = begin; i < end; ++i) {
    if (near_z[i] != near_z[i]) continue;  // NaN: the splat touches no pixel
    const probed p = probe_entry(records, extra, attributes, i, x, y);
    const int disc = p.hit.numerator <= reach * reach * (p.hit.den * p.hit.den) && p.hit.den > R(0.0);
    const real r2 = filter_radius2(&p, inverse_radius2);
    if (disc || r2 <= reach * reach) found[place++] = ids[i];
  }
  num_found[get_global_id(0)] = place - begin;
}

// Find depth(p), as visibility.cl does.
kernel void probe_depth(global const ProjectedSplat *records, global const ProjectedExtra *extra,
                        global const SplatAttributes *attributes, global const int *ids, const int num_records,
                        const int x, const int y, const real near, const real far, global real *depth,
                        global uint *particleid)
{
  depth[0] = (real)INFINITY;
  particleid[0] = NO_SPLAT;
  for (int i = 0; i < num_records; ++i) {
    const probed p = probe_entry(records, extra, attributes, i, x, y);
    real z = hit_depth(&p.disc, &p.hit, divide(R(1.0), p.hit.den));
    int covered = p.hit.inside && z >= near && z <= far;
#if ELLIPSE
    if (!covered) z = p.record.center_z;
    covered = ellipse_radius2(&p.extra, &p.extra.shape, &p.hit) <= R(1.0);
#endif
#if POINT
    covered &= x >= p.record.x_min && x <= p.record.x_max && y >= p.record.y_min && y <= p.record.y_max;
#endif
    if (!covered || !kept_by_lines(&p.extra, &p.hit) || !(z < depth[0])) continue;
    depth[0] = z;
    particleid[0] = ids[i];
  }
}

// Write every splat at the pixel, in splat order, and the sums after it, as in attributes.cl.
kernel void probe_rows(constant View *view, global const ProjectedSplat *records, global const ProjectedExtra *extra,
                       global const SplatAttributes *attributes, global const int *ids, const int num_records,
                       const int x, const int y, const real near, const real far, global const real *depth,
                       const real epsilon, const int along_ray, const real falloff, const real inverse_radius2,
                       constant real *table, const int table_size, global const short4 *boxes,
                       global ProbedSplat *rows FRAGMENT_LIGHT_PARAMETERS)
{
  const real farthest = farthest_accepted(view, (reals)x, (reals)y, depth[0], epsilon, along_ray);
  const fragment_settings r = {near, far, falloff, inverse_radius2, table, table_size, 0, 0 FRAGMENT_LIGHT_ARGUMENTS};
  real8 t = (real8)R(0.0);
  uint count = 0;
  for (int i = 0; i < num_records; ++i) {
    const probed p = probe_entry(records, extra, attributes, i, x, y);
    const real inverse_den = divide(R(1.0), p.hit.den);
    const real disc_z = hit_depth(&p.disc, &p.hit, inverse_den);
    const int in_range = disc_z >= near && disc_z <= far, kept = kept_by_lines(&p.extra, &p.hit) != 0;
#if POINT
    const short4 box = boxes[i];  // x_min, y_min, x_max, y_max
    const masks asked = -(masks)(x >= box.x && x <= box.z && y >= box.y && y <= box.w);
#else
    const masks asked = (masks)-1;
#endif
    const contribution f =
        contribution_at(&p.disc, &p.prefilter, &p.extra, (reals)x, (reals)y, asked, (reals)depth[0],
                        (reals)(real)INFINITY, &r);
    const int exists = f.accepted != 0, accepted = exists && is_accepted(f.z, farthest);
    real8 values;
    load_attributes(&values, attributes + i);
    if (accepted) add_lane(&t, &values, &f, 0);
    count += accepted;
    const int filtered = ELLIPSE ? 1 : PREFILTER ? magnitude(p.prefilter.x) < FILTERED : 0;
    const real8 sums = as_values(t);
    rows[i] = (ProbedSplat){
        p.hit.u * inverse_den, p.hit.v * inverse_den,
        p.hit.den > R(0.0) ? square_root(p.hit.numerator) * inverse_den : (real)INFINITY,
        filtered ? square_root(filter_radius2(&p, inverse_radius2)) : (real)INFINITY,
        exists ? f.z : disc_z, f.weight, sums.SUM_WEIGHT, sums.s0, sums.s1, sums.s2, sums.s3, sums.s4, sums.s5,
        ids[i], count,
        (p.hit.inside && in_range && kept ? STATE_HIT : 0) | (p.hit.inside && !in_range ? STATE_OUT : 0) |
            (exists ? STATE_EXISTS : 0) | (accepted ? STATE_ACCEPTED : 0) |
            (p.record.u_1 == R(2.0) ? STATE_EDGE_ON : 0) | (kept ? 0 : STATE_CUT)};
  }
}
