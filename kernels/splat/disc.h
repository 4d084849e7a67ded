// Provides the intersection of a pixel's ray with a disc: coverage, disc coordinates and depth.
//
// The visibility pass and the attribute pass share this code, so both decide coverage and depth with the same bits.
//
// ORTHOGRAPHIC  1: the projection is orthographic, 0: perspective

#include "arithmetic/reals.h"

#define NO_SPLAT 0xffffffffu  // the particleid of a pixel that no disc covers

// The pixels of LANES boxes, both ends included; a box is empty if x_first > x_last or y_first > y_last.
typedef struct {
  reals x_first, x_last, y_first, y_last;
} boxes;

// LANES projected splats, or one splat in all lanes.
typedef struct {
  reals pixel_x, pixel_y, offset_x, offset_y, u_x, u_y, u_1, v_x, v_y, v_1, g_x, g_y, z;
} discs;

static inline discs disc_of(const ProjectedSplat *s)
{
  discs d = {s->pixel_x, s->pixel_y, s->offset_x, s->offset_y, s->u_x, s->u_y, s->u_1,
             s->v_x,     s->v_y,     s->v_1,      s->g_x,      s->g_y, s->z};
  return d;
}

typedef struct {
  reals dx, dy;           // from the reference point to the pixel's center, pixels
  reals u, v, numerator;  // disc coordinates times den; u^2 + v^2
  reals den;              // 1 + g.(dx, dy); 1 when orthographic
  masks inside;           // u^2 + v^2 <= 1 in front of the eye; near and far are not tested yet
} hit;

// x, y, pixel_x and pixel_y are whole numbers: their differences are exact, so dx and dy are rounded once.
static inline hit intersect(const discs *s, reals x, reals y)
{
  hit h;
  h.dx = (x - s->pixel_x) - s->offset_x;
  h.dy = (y - s->pixel_y) - s->offset_y;
  h.u = (s->u_x * h.dx + s->u_y * h.dy) + s->u_1;
  h.v = (s->v_x * h.dx + s->v_y * h.dy) + s->v_1;
#if ORTHOGRAPHIC
  h.den = (reals)R(1.0);
  h.numerator = h.u * h.u + h.v * h.v;
  h.inside = MASK(h.numerator <= R(1.0));
#else
  h.den = (s->g_x * h.dx + s->g_y * h.dy) + R(1.0);
  h.numerator = h.u * h.u + h.v * h.v;
  h.inside = MASK(h.numerator <= h.den * h.den) & MASK(h.den > R(0.0));
#endif
  return h;
}

// Eye-space z of the disc on the pixel's ray.
static inline reals hit_depth(const discs *s, const hit *h, reals inverse_den)
{
#if ORTHOGRAPHIC
  return (s->g_x * h->dx + s->g_y * h->dy) + s->z;
#else
  return inverse_den * s->z;
#endif
}
