// Provides the screen-space ellipses of LANES discs, and EWA's low-pass filter of these ellipses.
//
// The disc's contour in homogeneous coordinates gives the ellipse of variance V = (p p^T w + q q^T) / w^2 about -q / w.
// Here P are the tangents moved to the center's plane, p p^T = P P^T, q = P t_z / z and w = 1 - |t_z|^2 / z^2
// ([ZRB04]). The affine map exact at the center has q = 0 and w = 1 ([ZPvBG01]). Nothing here cancels.
//
// ELLIPSE, PREFILTER  as in splat/extra.h

#include "arithmetic/reals.h"
#include "arithmetic/divide.h"
#include "arithmetic/vectors.h"
#include "splat/extra.h"
#include "projection/bounds.h"

typedef struct {
  reals x, y;               // from the projected center to the ellipse's, pixels
  reals xx, xy, yy, area2;  // V and |V|: r^2 = x^T V^-1 x is 1 at the contour
  masks exists;
} ellipse;

static inline ellipse ellipse_of(constant View *view, reals3 c, reals3 tu, reals3 tv, reals3 g, reals reach)
{
  ellipse e;
  reals depth = R(1.0), ux = tu.x, uy = tu.y, vx = tv.x, vy = tv.y, area = g.z;
  e.exists = MASK(c.z >= view->near) & MASK(c.z <= view->far);
#if !ORTHOGRAPHIC
  depth = divide(R(1.0), c.z);
  const reals slope_x = c.x * depth, slope_y = c.y * depth;
  ux = (ux - slope_x * tu.z) * depth;
  uy = (uy - slope_y * tu.z) * depth;
  vx = (vx - slope_x * tv.z) * depth;
  vy = (vy - slope_y * tv.z) * depth;
  area = ((dot3(g, c) * depth) * depth) * depth;
#endif
  reals inverse_w = R(1.0), qx = R(0.0), qy = R(0.0);
#if !ORTHOGRAPHIC && ELLIPSE == CONIC
  const reals tu_z = tu.z * depth, tv_z = tv.z * depth, deep = reach * depth;
  inverse_w = divide(R(1.0), (R(1.0) - deep) * (R(1.0) + deep));
  qx = ux * tu_z + vx * tv_z;
  qy = uy * tu_z + vy * tv_z;
  e.exists &= MASK(c.z - reach > c.z * CLEAR);  // otherwise the contour is no ellipse
#endif
  const reals fx = view->fx_hi, fy = view->fy_hi;
  e.x = -(qx * inverse_w) * fx;
  e.y = -(qy * inverse_w) * fy;
  e.xx = ((qx * qx) * inverse_w + (ux * ux + vx * vx)) * inverse_w * fx * fx;
  e.xy = ((qx * qy) * inverse_w + (ux * uy + vx * vy)) * inverse_w * fx * fy;
  e.yy = ((qy * qy) * inverse_w + (uy * uy + vy * vy)) * inverse_w * fy * fy;
  area = area * fx * fy;
  e.area2 = (area * area) * ((inverse_w * inverse_w) * inverse_w);
  return e;
}

// The inverse of V's Cholesky factor. area2 is the determinant of V, computed without cancellation.
static inline ellipse_form form_of(reals xx, reals xy, reals area2, masks exists)
{
  const reals short_axis = square_root(divide(area2, xx));
  ellipse_form f = {divide(R(1.0), square_root(xx)), divide(-xy, xx * short_axis), divide(R(1.0), short_axis)};
  f.a = SELECT(R(1.0), f.a, exists);
  f.b = SELECT(R(0.0), f.b, exists);
  f.c = SELECT(R(1.0), f.c, exists);
  return f;
}

// Give the ellipse in the form of the raster passes, and its extents with the low-pass filter. (center_x, center_y)
// leads from the reference point to the projected center.
static inline void filter_ellipse(constant View *view, const ellipse *e, reals center_x, reals center_y, extras *to,
                                  extent *across, extent *down)
{
  to->x = SELECT(NOWHERE, center_x + e->x, e->exists);
  to->y = SELECT(NOWHERE, center_y + e->y, e->exists);
  to->shape = form_of(e->xx, e->xy, e->area2, e->exists);
  reals xx = e->xx, yy = e->yy;
#if PREFILTER == EWA
  const real h = view->low_pass;  // cutoff^2 times the filter's variance
  const reals filtered2 = e->area2 + ((e->xx + e->yy) * h + h * h);
  xx = xx + h;
  yy = yy + h;
  to->filtered = form_of(xx, e->xy, filtered2, e->exists);
  to->factor = at_most(at_least(square_root(divide(e->area2, filtered2)), R(0.0)), R(1.0));
#endif
  across->middle = center_x + e->x;
  across->reach = square_root(xx);
  down->middle = center_y + e->y;
  down->reach = square_root(yy);
}
