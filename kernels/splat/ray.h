// The rays of pixels, d = ((x - cx)/fx, (y - cy)/fy, 1): their parameter is eye-space z. Needs arithmetic.h.
// View's cx, cy count from the centre of the image's pixel 0; x, y from the window's first pixel.

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

static inline reals3 ray_point(reals3 d, reals z) { return ORTHOGRAPHIC ? (reals3){d.x, d.y, z} : scale3(d, z); }
