// The ray of a pixel, d = ((x - cx)/fx, (y - cy)/fy, 1): its parameter is eye-space z. Needs arithmetic.h.
// View's cx, cy count from the centre of pixel 0.

static inline real ray_x(constant View *view, int x)
{
  return divide_real(((real)x - view->cx_hi) - view->cx_lo, view->fx_hi);
}

static inline real ray_y(constant View *view, int y)
{
  return divide_real(((real)y - view->cy_hi) - view->cy_lo, view->fy_hi);
}
