// Near is bright: near/z, or, orthographic, w / (w + z - near) with w the image's width in scene units.

#define TAKES_PIXELS

static inline reals3 shade_pixels(const Surface *s, constant Shading *shading, constant PhongLight *lights,
                                  const Pixels *at, constant Npr *npr, constant real *tones)
{
  const reals z = s->position.z;
#if ORTHOGRAPHIC
  const reals width = divide((reals)(real)at->view->width, (reals)at->view->fx_hi);
  const reals grey = divide(width, width + (z - at->view->near));
#else
  const reals grey = divide((reals)at->view->near, z);
#endif
  return (reals3){grey, grey, grey};
}
