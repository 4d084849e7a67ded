// Probe: the passes at one pixel, splat by splat, with the functions and so the bits of the frame itself.

#include "arithmetic.h"
#include "ray.h"
#include "splat.h"
#include "lanes.h"
#include "transpose.h"
#include "extra.h"
#include "fragment.h"
#include "weight.h"

#define NO_SPLAT 0xffffffffu

// Bits of ProbedSplat.state (splatcl/probe.py).
#define HIT 1        // the disc is hit
#define OUT 2        // the disc is hit, but not within near..far
#define EXISTS 4     // there is a fragment, of the disc or of the pre-filter
#define ACCEPTED 8   // and it is accumulated
#define EDGE_ON 16

#define FILTERED R(1e8)  // where there is no pre-filter its centre is farther off than this (project.cl, NOWHERE)

// The splats of each chunk of records whose disc or pre-filter, `reach` times as large, covers the pixel.
kernel void probe_select(global const ProjectedSplat *records, global const SplatAttributes *attributes,
                         global const real *near_z, global const int *ids, const int num_records,
                         const int chunk_size, const int x, const int y, const real reach, const real inverse_radius2,
                         global int *found, global int *num_found)
{
  const int begin = get_global_id(0) * chunk_size, end = least(begin + chunk_size, num_records);
  int place = begin;
  for (int i = begin; i < end; ++i) {
    if (near_z[i] != near_z[i]) continue;  // it touches no pixel of the image
    const ProjectedSplat s = records[i];
    const SplatAttributes a = attributes[i];
    const discs d = disc_of(&s);
    const prefilters p = prefilter_of(&s, &a);
    const hit h = intersect(&d, (reals)x, (reals)y);
    const int disc = h.numerator <= reach * reach * (h.den * h.den) && h.den > R(0.0);
    if (disc || screen_radius2(&p, &h, inverse_radius2) <= reach * reach) found[place++] = ids[i];
  }
  num_found[get_global_id(0)] = place - begin;
}

// depth(p), as visibility.cl finds it.
kernel void probe_depth(global const ProjectedSplat *records, global const int *ids, const int num_records,
                        const int x, const int y, const real near, const real far, global real *depth,
                        global uint *particleid)
{
  depth[0] = (real)INFINITY;
  particleid[0] = NO_SPLAT;
  for (int i = 0; i < num_records; ++i) {
    const ProjectedSplat s = records[i];
    const discs d = disc_of(&s);
    const hit h = intersect(&d, (reals)x, (reals)y);
    const real z = hit_depth(&d, &h, divide(R(1.0), h.den));
    if (!h.inside || !(z < depth[0]) || z < near || z > far) continue;
    depth[0] = z;
    particleid[0] = ids[i];
  }
}

// Every splat at the pixel, in splat order, and the sums after it, as attributes.cl takes them.
kernel void probe_rows(constant View *view, global const SplatAttributes *attributes,
                       global const ProjectedSplat *records, global const int *ids, const int num_records,
                       const int x, const int y, const real near, const real far, global const real *depth,
                       const real epsilon, const int along_ray, const real falloff, const real inverse_radius2,
                       constant real *table, const int table_size, global ProbedSplat *rows)
{
  const real farthest = farthest_accepted(view, (reals)x, (reals)y, depth[0], epsilon, along_ray);
  real8 t = (real8)R(0.0);
  uint count = 0;
  for (int i = 0; i < num_records; ++i) {
    const ProjectedSplat s = records[i];
    const SplatAttributes a = attributes[i];
    const discs d = disc_of(&s);
    const prefilters p = prefilter_of(&s, &a);
    const hit h = intersect(&d, (reals)x, (reals)y);
    const real inverse_den = divide(R(1.0), h.den);
    const real disc_z = hit_depth(&d, &h, inverse_den);
    const int in_range = disc_z >= near && disc_z <= far;
    const fragment f = filter(&d, &p, &h, near, far, inverse_radius2);
    const int accepted = f.exists && f.z <= farthest;
    const real weight = f.exists ? weight_of(f.r2, falloff, table, table_size) : R(0.0);
    real8 values;
    load_attributes(&values, attributes + i);
    if (accepted) accumulate(&t, &values, weight, f.z);
    count += accepted;
    const int filtered = PREFILTER && magnitude(a.prefilter_x) < FILTERED;
    rows[i] = (ProbedSplat){
        h.u * inverse_den, h.v * inverse_den,
        h.den > R(0.0) ? square_root(h.numerator) * inverse_den : (real)INFINITY,
        filtered ? square_root(screen_radius2(&p, &h, inverse_radius2)) : (real)INFINITY,
        f.exists ? f.z : disc_z, weight, t.SUM_WEIGHT, t.s0, t.s1, t.s2, t.s3, t.s4, t.s5, ids[i], count,
        (h.inside && in_range ? HIT : 0) | (h.inside && !in_range ? OUT : 0) | (f.exists ? EXISTS : 0) |
            (accepted ? ACCEPTED : 0) | (s.u_1 == R(2.0) ? EDGE_ON : 0)};
  }
}
