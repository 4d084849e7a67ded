// The rays of pixels, d = ((x - cx)/fx, (y - cy)/fy, 1): their parameter is eye-space z. Needs arithmetic.h.
// View's cx, cy count from the centre of pixel 0.

static inline reals ray_x(constant View *view, reals x) { return divide((x - view->cx_hi) - view->cx_lo, view->fx_hi); }

static inline reals ray_y(constant View *view, reals y) { return divide((y - view->cy_hi) - view->cy_lo, view->fy_hi); }
