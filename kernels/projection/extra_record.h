// Provides the projection of the data that methods other than [BHZK05]'s use, and store_extras, which writes its
// records.

#include "arithmetic/reals.h"
#include "arithmetic/vectors.h"
#include "arithmetic/lanes.h"
#include "splat/eye.h"
#include "splat/extra.h"
#include "projection/record.h"

// Whether the splats themselves have any of these groups.
#define OF_SPLAT (CLIP || FIELD || GLOSS)

#if OF_SPLAT
#define OF_WORLD(lane, field) in[ids[entry[lane]]].field
#define WORLD(field) ((reals)EACH_LANE(OF_WORLD, field))
#endif

// The form over pixels of a clip line a u + b v + c; times den, it is linear. An edge-on splat has no u and v
// (project.cl sets u_1 = 2): the line keeps all of it or nothing, as it does its center.
static inline void clip_form(const projected *s, reals a, reals b, reals c, reals *x, reals *y, reals *one)
{
  const masks edge_on = MASK(s->u_1 == R(2.0));
  *x = a * s->u_x + b * s->v_x;
  *y = a * s->u_y + b * s->v_y;
#if !ORTHOGRAPHIC
  *x = *x + c * s->g_x;
  *y = *y + c * s->g_y;
#endif
  *one = SELECT((a * s->u_1 + b * s->v_1) + c, c, edge_on);
}

static inline void project_extras(constant View *view, projected *s, global const SplatExtra *in,
                                  global const int *ids, const int *entry)
{
#if CLIP
  clip_form(s, WORLD(clip0_x), WORLD(clip0_y), WORLD(clip0_1), &s->extra.clip_x[0], &s->extra.clip_y[0],
            &s->extra.clip_1[0]);
  clip_form(s, WORLD(clip1_x), WORLD(clip1_y), WORLD(clip1_1), &s->extra.clip_x[1], &s->extra.clip_y[1],
            &s->extra.clip_1[1]);
#endif
#if FIELD
  const reals3 du = {WORLD(du_x), WORLD(du_y), WORLD(du_z)}, dv = {WORLD(dv_x), WORLD(dv_y), WORLD(dv_z)};
  const reals sign = SELECT((reals)R(1.0), (reals)R(-1.0), s->turned);
  s->extra.normal_du = scale3(rotate(view, du), sign);
  s->extra.normal_dv = scale3(rotate(view, dv), sign);
#endif
#if GLOSS
  s->extra.specular = WORLD(specular);  // NaN: the material's holds
  s->extra.shininess = WORLD(shininess);
#endif
}

static inline void store_extras(global ProjectedExtra *to, const int *entry, int num, const projected *s)
{
  for (int lane = 0; lane < num; ++lane) {
    global ProjectedExtra *r = to + entry[lane];
#if ELLIPSE
    r->x = LANE_OF(s->extra.x, lane);
    r->y = LANE_OF(s->extra.y, lane);
    r->a = LANE_OF(s->extra.shape.a, lane);
    r->b = LANE_OF(s->extra.shape.b, lane);
    r->c = LANE_OF(s->extra.shape.c, lane);
#endif
#if ELLIPSE && PREFILTER == EWA
    r->ewa_a = LANE_OF(s->extra.filtered.a, lane);
    r->ewa_b = LANE_OF(s->extra.filtered.b, lane);
    r->ewa_c = LANE_OF(s->extra.filtered.c, lane);
    r->factor = LANE_OF(s->extra.factor, lane);
#endif
#if CLIP
    r->clip0_x = LANE_OF(s->extra.clip_x[0], lane);
    r->clip0_y = LANE_OF(s->extra.clip_y[0], lane);
    r->clip0_1 = LANE_OF(s->extra.clip_1[0], lane);
    r->clip1_x = LANE_OF(s->extra.clip_x[1], lane);
    r->clip1_y = LANE_OF(s->extra.clip_y[1], lane);
    r->clip1_1 = LANE_OF(s->extra.clip_1[1], lane);
#endif
#if FIELD
    r->du_x = LANE_OF(s->extra.normal_du.x, lane);
    r->du_y = LANE_OF(s->extra.normal_du.y, lane);
    r->du_z = LANE_OF(s->extra.normal_du.z, lane);
    r->dv_x = LANE_OF(s->extra.normal_dv.x, lane);
    r->dv_y = LANE_OF(s->extra.normal_dv.y, lane);
    r->dv_z = LANE_OF(s->extra.normal_dv.z, lane);
#endif
#if GLOSS
    r->specular = LANE_OF(s->extra.specular, lane);
    r->shininess = LANE_OF(s->extra.shininess, lane);
#endif
  }
}
