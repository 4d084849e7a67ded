// Provides the rays of pixels, d = ((x - cx)/fx, (y - cy)/fy, 1). The parameter along a ray is eye-space z.
//
// View's cx and cy count from the center of the image's pixel 0, x and y from the first pixel of the window.
//
// ORTHOGRAPHIC  1: the projection is orthographic, 0: perspective

#include "arithmetic/reals.h"
#include "arithmetic/divide.h"
#include "arithmetic/vectors.h"

static inline reals ray_x(constant View *view, reals x)
{
  return divide(((x + (real)view->first_column) - view->cx_hi) - view->cx_lo, view->fx_hi);
}

static inline reals ray_y(constant View *view, reals y)
{
  return divide(((y + (real)view->first_row) - view->cy_hi) - view->cy_lo, view->fy_hi);
}

// The point at depth z on ray d.
static inline reals3 ray_point(reals3 d, reals z) { return ORTHOGRAPHIC ? (reals3){d.x, d.y, z} : scale3(d, z); }
