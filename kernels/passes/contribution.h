// Provides the contributions of fragments to the sums of pixels: weighted and, in forward shading, shaded.
//
// SHADER   the header with shade_surface()
// SHADING  as in splat/extra.h; PER_FRAGMENT shades here

#include "arithmetic/reals.h"
#include "arithmetic/vectors.h"
#include "arithmetic/lanes.h"
#include "splat/ray.h"
#include "splat/disc.h"
#include "splat/extra.h"
#include "splat/weight.h"
#include "splat/target.h"
#include "splat/fragment.h"
#include "shading/surface.h"
#include "shading/forward.h"

#if SHADING == PER_FRAGMENT
#define FRAGMENT_LIGHT_PARAMETERS FORWARD_PARAMETERS
#define FRAGMENT_LIGHT_ARGUMENTS , view, shading, lights
#else
#define FRAGMENT_LIGHT_PARAMETERS
#define FRAGMENT_LIGHT_ARGUMENTS
#endif

// The settings that all fragments of a work-item share.
typedef struct {
  real near, far, falloff, inverse_radius2;
  constant real *table;
  int table_size, left, top;
#if SHADING == PER_FRAGMENT
  constant View *view;
  constant Shading *shading;
  constant PhongLight *lights;
#endif
} fragment_settings;

// The contributions at LANES pixels or of LANES splats: zero where no fragment exists or it is not accepted.
typedef struct {
  reals weight, z;
  masks accepted;
#if VARYING
  reals3 color, normal;
#endif
} contribution;

#if VARYING
// Give the fragments' own normals (normal fields) and their shaded colors ([BSK04]).
static inline void vary(contribution *t, const extras *e, const hit *h, const fragment *f, reals x, reals y,
                        const fragment_settings *r)
{
  t->color = e->color;
  t->normal = e->normal;
#if FIELD
  const reals u = SELECT(R(0.0), h->u * f->inverse_den, f->disc), v = SELECT(R(0.0), h->v * f->inverse_den, f->disc);
  t->normal = normalize3(add3(e->normal, add3(scale3(e->normal_du, u), scale3(e->normal_dv, v))));
#endif
#if SHADING == PER_FRAGMENT
  // From the window's first pixel.
  const reals column = x - (real)r->view->first_column, row = y - (real)r->view->first_row;
  const reals3 d = {ray_x(r->view, column), ray_y(r->view, row), R(1.0)};
  const reals3 position = ray_point(d, t->z);
  const surfaces s = surface_point(position, d, t->normal, t->color, e, r->shading);
  t->color = shade_surface(&s, r->shading, r->lights);
#endif
}
#endif

// The contributions at pixels x, y from (left, top) where `asked`. `front` is depth(p), as for
// fragment_of, and `farthest` is depth(p) + epsilon.
static inline contribution contribution_at(const discs *s, const prefilters *p, const extras *e, reals x, reals y,
                                           masks asked, reals front, reals farthest, const fragment_settings *r)
{
  const hit h = intersect(s, x + (real)r->left, y + (real)r->top);
  const fragment f = fragment_of(s, p, e, &h, front, r->near, r->far, r->inverse_radius2);
  const masks accepted = f.exists & asked & is_accepted(f.z, farthest);
  contribution t;
  t.weight = t.z = (reals)R(0.0);
  t.accepted = accepted;
#if VARYING
  t.color = e->color;
  t.normal = e->normal;
#endif
  if (!ANY(accepted)) return t;
  reals weight = weight_of(f.r2, r->falloff, r->table, r->table_size);
#if PREFILTER == EWA
  weight = weight * e->factor;
#endif
  t.weight = SELECT(R(0.0), weight, accepted);
  t.z = SELECT(R(0.0), f.z, accepted);
#if VARYING
  vary(&t, e, &h, &f, x + (real)r->left, y + (real)r->top, r);
#endif
  return t;
}

// Add one lane's contribution to a pixel's sums. Adding zero does not change the bits of a sum.
static inline void add_lane(real8 *sums, const real8 *attributes, const contribution *f, int lane)
{
#if VARYING
  real8 own = *attributes;
  own.s0 = LANE_OF(f->color.x, lane);
  own.s1 = LANE_OF(f->color.y, lane);
  own.s2 = LANE_OF(f->color.z, lane);
  own.s3 = LANE_OF(f->normal.x, lane);
  own.s4 = LANE_OF(f->normal.y, lane);
  own.s5 = LANE_OF(f->normal.z, lane);
#if TARGET == UNORM8
  own.s345 = own.s345 * R(0.5) + R(0.5);
#endif
  accumulate(sums, &own, LANE_OF(f->weight, lane), LANE_OF(f->z, lane));
#else
  accumulate(sums, attributes, LANE_OF(f->weight, lane), LANE_OF(f->z, lane));
#endif
}
