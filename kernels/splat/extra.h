// Provides the data of a splat that methods other than [BHZK05]'s use: screen-space ellipse, clip lines, normal field
// and specular reflection.
//
// ELLIPSE       footprints are ellipses: 1 of the affine map exact at the center, 2 of the projected contour; 0: discs
// PREFILTER     1: min(r3, r2), 2: EWA, 0: none
// FILTER_DEPTH  depth of a fragment of the pre-filter alone: 0 the center's, 1 the plane's, 2 depth(p)
// CLIP          1: splats have clip lines
// FIELD         1: normals are linear fields
// SHADING       0: deferred, once per pixel; forward: 1 each fragment, 2 each splat
// GLOSS         1: splats have their own specular coefficient and shininess

#include "arithmetic/reals.h"
#include "arithmetic/vectors.h"
#include "arithmetic/lanes.h"
#include "splat/disc.h"

#define AFFINE 1
#define CONIC 2
#define MIN_FILTER 1
#define EWA 2
#define PLANE_DEPTH 1
#define FRONT_DEPTH 2
#define PER_FRAGMENT 1
#define PER_SPLAT 2
#define VARYING (FIELD || SHADING == PER_FRAGMENT)  // fragments of one splat differ in color or normal
#define EXTRA (ELLIPSE || CLIP || VARYING || GLOSS)  // entries have a ProjectedExtra record

// r^2 = (a x)^2 + (b x + c y)^2 of the point (x, y) from the center of an ellipse, pixels.
typedef struct {
  reals a, b, c;
} ellipse_form;

// LANES splats, or one splat in all lanes.
typedef struct {
  reals x, y;                   // from the reference point to the ellipse's center, pixels
  ellipse_form shape, filtered;  // of the footprint, without and with EWA's low-pass filter
  reals factor;                 // EWA: sqrt(|V| / |V + H|)
  reals clip_x[2], clip_y[2], clip_1[2];  // linear forms over the offset from the reference point; negative: cut off
  reals3 color, normal, normal_du, normal_dv;
  reals specular, shininess;
} extras;

#define OF_EXTRA(lane, field) extra[place[lane]].field
#define GATHER(field) ((reals)EACH_LANE(OF_EXTRA, field))
#define OF_ATTRIBUTES(lane, field) attributes[place[lane]].field
#define GATHER_OWN(field) ((reals)EACH_LANE(OF_ATTRIBUTES, field))

static inline void load_footprints(extras *e, global const ProjectedExtra *extra, const int *place)
{
#if ELLIPSE
  e->x = GATHER(x);
  e->y = GATHER(y);
  e->shape.a = GATHER(a);
  e->shape.b = GATHER(b);
  e->shape.c = GATHER(c);
#endif
#if ELLIPSE && PREFILTER == EWA
  e->filtered.a = GATHER(ewa_a);
  e->filtered.b = GATHER(ewa_b);
  e->filtered.c = GATHER(ewa_c);
  e->factor = GATHER(factor);
#endif
#if CLIP
  e->clip_x[0] = GATHER(clip0_x);
  e->clip_y[0] = GATHER(clip0_y);
  e->clip_1[0] = GATHER(clip0_1);
  e->clip_x[1] = GATHER(clip1_x);
  e->clip_y[1] = GATHER(clip1_y);
  e->clip_1[1] = GATHER(clip1_1);
#endif
}

static inline void load_extras(extras *e, global const ProjectedExtra *extra, global const SplatAttributes *attributes,
                               const int *place)
{
  load_footprints(e, extra, place);
#if VARYING
  e->color.x = GATHER_OWN(red);
  e->color.y = GATHER_OWN(green);
  e->color.z = GATHER_OWN(blue);
  e->normal.x = GATHER_OWN(normal_x);
  e->normal.y = GATHER_OWN(normal_y);
  e->normal.z = GATHER_OWN(normal_z);
#endif
#if FIELD
  e->normal_du.x = GATHER(du_x);
  e->normal_du.y = GATHER(du_y);
  e->normal_du.z = GATHER(du_z);
  e->normal_dv.x = GATHER(dv_x);
  e->normal_dv.y = GATHER(dv_y);
  e->normal_dv.z = GATHER(dv_z);
#endif
#if SHADING == PER_FRAGMENT && GLOSS
  e->specular = GATHER(specular);
  e->shininess = GATHER(shininess);
#endif
}

// One entry in all lanes.
static inline void load_one_footprint(extras *e, global const ProjectedExtra *extra, int entry)
{
  int place[LANES];
  for (int lane = 0; lane < LANES; ++lane) place[lane] = entry;
  load_footprints(e, extra, place);
}

static inline void load_one_extra(extras *e, global const ProjectedExtra *extra,
                                  global const SplatAttributes *attributes, int entry)
{
  int place[LANES];
  for (int lane = 0; lane < LANES; ++lane) place[lane] = entry;
  load_extras(e, extra, attributes, place);
}

// A line belongs to both splats that it divides, rounding errors of its form included, so no crack opens between them.
#define LINE_SLACK (DOUBLE ? R(1.7763568394002505e-15) : R(9.5367431640625e-7))  // 16 roundings of its terms

static inline masks kept_by_line(const extras *e, const hit *h, int line)
{
  const reals x = e->clip_x[line] * h->dx, y = e->clip_y[line] * h->dy, one = e->clip_1[line];
  const reals size = (magnitude(x) + magnitude(y)) + magnitude(one);
  return MASK((x + y) + one >= size * -LINE_SLACK);
}

// Whether both clip lines keep the pixels.
static inline masks kept_by_lines(const extras *e, const hit *h)
{
#if CLIP
  return kept_by_line(e, h, 0) & kept_by_line(e, h, 1);
#else
  return (masks)-1;
#endif
}

// r^2 of the pixels by the form of an ellipse; at most 1 inside.
static inline reals ellipse_radius2(const extras *e, const ellipse_form *form, const hit *h)
{
  const reals x = h->dx - e->x, y = h->dy - e->y;
  const reals p = form->a * x, q = form->b * x + form->c * y;
  return p * p + q * q;
}
