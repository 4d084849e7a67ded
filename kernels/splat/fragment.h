// Provides fragments, whether a splat has one at a pixel, its depth and radius, and the sums of a pixel's fragments.
//
// The attribute pass shares this code with the probe and the accounting, so they see the same fragments.
//
// CHANNELS        1: six further channels of each splat are summed, 0: color and normal
// STRICT_EPSILON  1: z < depth(p) + epsilon accepts a fragment, 0: z <= depth(p) + epsilon

#include "arithmetic/reals.h"
#include "arithmetic/divide.h"
#include "arithmetic/transpose.h"
#include "splat/ray.h"
#include "splat/disc.h"
#include "splat/extra.h"
#include "splat/target.h"

// The pre-filter's data of LANES splats, or of one splat in all lanes.
typedef struct {
  reals x, y;  // from the reference point to the pre-filter's center, pixels
  reals center_z;
} prefilters;

static inline prefilters prefilter_of(const ProjectedSplat *s, const SplatAttributes *a)
{
  prefilters p = {a->prefilter_x, a->prefilter_y, s->center_z};
  return p;
}

typedef struct {
  reals r2, z, inverse_den;
  masks exists, disc;  // `disc`: the ray hits the disc
} fragment;

// r2^2, for any setting of the pre-filter.
static inline reals screen_radius2(const prefilters *p, const hit *h, real inverse_radius2)
{
  const reals x = h->dx - p->x, y = h->dy - p->y;
  return (x * x + y * y) * inverse_radius2;
}

#if FILTER_DEPTH
// The depth of a fragment that only the pre-filter accepts; the center's where the plane is edge-on (project.cl sets
// u_1 = 2) or its z is outside near..far, and where no disc is hit. `front` is depth(p).
static inline reals filter_depth(const discs *s, const prefilters *p, const hit *h, reals plane_z, reals front,
                                 real near, real far)
{
#if FILTER_DEPTH == PLANE_DEPTH
  const masks in_range = MASK(plane_z >= near) & MASK(plane_z <= far);
  return SELECT(p->center_z, plane_z, MASK(h->den > R(0.0)) & in_range & ~MASK(s->u_1 == R(2.0)));
#else
  return SELECT(p->center_z, front, MASK(front < (real)INFINITY));
#endif
}
#endif

// r^2 = min(r3^2, r2^2), or the ellipse's r^2. Where the ray misses the disc, the depth is the center's, or
// filter_depth() for the pre-filter alone. `front` is depth(p), which FRONT_DEPTH alone reads.
static inline fragment fragment_of(const discs *s, const prefilters *p, const extras *e, const hit *h, reals front,
                                   real near, real far, real inverse_radius2)
{
  fragment f;
  f.inverse_den = divide(R(1.0), h->den);
  f.z = hit_depth(s, h, f.inverse_den);
#if FILTER_DEPTH
  const reals plane_z = f.z;
#endif
  const masks kept = kept_by_lines(e, h);
  f.disc = h->inside & MASK(f.z >= near) & MASK(f.z <= far) & kept;
#if ELLIPSE
  f.z = SELECT(p->center_z, f.z, f.disc);
  f.r2 = ellipse_radius2(e, PREFILTER == EWA ? &e->filtered : &e->shape, h);
  f.exists = MASK(f.r2 <= R(1.0)) & kept;
  f.r2 = at_most(f.r2, R(1.0));
#else
  f.exists = f.disc;
  f.r2 = at_most(h->numerator * (f.inverse_den * f.inverse_den), R(1.0));
#endif
#if PREFILTER == MIN_FILTER
  const reals screen_r2 = screen_radius2(p, h, inverse_radius2);
  f.r2 = SELECT(screen_r2, f.r2, f.exists & MASK(f.r2 < screen_r2));
  f.z = SELECT(p->center_z, f.z, ELLIPSE ? f.disc : f.exists);
#if FILTER_DEPTH
  f.z = SELECT(filter_depth(s, p, h, plane_z, front, near, far), f.z, f.exists | f.disc);
#endif
  f.exists |= MASK(screen_r2 <= R(1.0)) & kept;
#endif
  return f;
}

// depth(p) + epsilon. An epsilon along a perspective ray is shorter along z.
static inline reals farthest_accepted(constant View *view, reals x, reals y, reals depth, real epsilon, int along_ray)
{
  if (ORTHOGRAPHIC || !along_ray) return depth + epsilon;
  const reals dx = ray_x(view, x), dy = ray_y(view, y);
  return depth + divide(epsilon, square_root((dx * dx + dy * dy) + R(1.0)));
}

// The epsilon test; `farthest` is depth(p) + epsilon.
static inline masks is_accepted(reals z, reals farthest)
{
#if STRICT_EPSILON
  return MASK(z < farthest);
#else
  return MASK(z <= farthest);
#endif
}

// The sums of a pixel: weight times red, green, blue, normal_x, normal_y, normal_z, one and z.
#define SUM_WEIGHT s6
#define SUM_Z s7

// The values that a weight multiplies, except the depth of the fragment. (By pointer: no function takes eight doubles.)
static inline void load_attributes(real8 *values, global const SplatAttributes *a)
{
  *values = ((global const unaligned8 *)a)->values;  // the first six are color and normal
  values->SUM_WEIGHT = R(1.0);
#if TARGET == UNORM8
  values->s345 = values->s345 * R(0.5) + R(0.5);
#endif
}

// Add one fragment: weight times its values.
static inline void accumulate(real8 *sums, const real8 *attributes, real weight, real z)
{
  real8 values = *attributes;
  values.SUM_Z = z;
#if TARGET
  const real depth = sums->SUM_Z + weight * z;
  *sums = to_target(*sums + to_target((weight * values) * UNITS));
  sums->SUM_Z = depth;
#else
  *sums = *sums + weight * values;
#endif
}

// Divide the first six sums, those of color and normal or of channels.
static inline void divide_six(real8 *s, real by)
{
  s->s0 = divide_real(s->s0, by);
  s->s1 = divide_real(s->s1, by);
  s->s2 = divide_real(s->s2, by);
  s->s3 = divide_real(s->s3, by);
  s->s4 = divide_real(s->s4, by);
  s->s5 = divide_real(s->s5, by);
}

// The sums as values; sums of channels become means.
static inline real8 as_values(real8 s)
{
#if TARGET == UNORM8
#if !CHANNELS
  s.s345 = s.s345 * R(2.0) - s.SUM_WEIGHT;
#endif
  divide_six(&s, UNITS);
  s.SUM_WEIGHT = divide_real(s.SUM_WEIGHT, UNITS);
#endif
#if CHANNELS
  if (!(s.SUM_WEIGHT > R(0.0))) return (real8)R(0.0);
  divide_six(&s, s.SUM_WEIGHT);
#endif
  return s;
}
