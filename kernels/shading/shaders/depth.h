// Provides the shader depth, in which near is bright.
//
// Perspective near / z; orthographic (far - z) / (far - near), or 1 / (1 + z - near) for an infinite far.

#include "arithmetic/reals.h"
#include "arithmetic/divide.h"
#include "arithmetic/vectors.h"
#include "shading/surface.h"
#include "shading/gbuffer.h"

#define TAKES_PIXELS

static inline reals3 shade_pixels(const surfaces *s, constant Shading *shading, constant PhongLight *lights,
                                  const Pixels *at, constant Npr *npr, constant real *tones)
{
  const reals z = s->position.z;
#if ORTHOGRAPHIC
  const real near = at->view->near, far = at->view->far;
  const reals gray =
      far < (real)INFINITY ? divide(far - z, (reals)(far - near)) : divide((reals)R(1.0), R(1.0) + (z - near));
#else
  const reals gray = divide((reals)at->view->near, z);
#endif
  return (reals3){gray, gray, gray};
}
