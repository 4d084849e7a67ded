// Provides the shader normal, the blended normal as a color: right is red, up is green, toward the eye is blue.

#include "arithmetic/reals.h"
#include "arithmetic/vectors.h"
#include "shading/surface.h"

static inline reals3 shade_surface(const surfaces *s, constant Shading *shading, constant PhongLight *lights)
{
  return (reals3){R(0.5) + R(0.5) * s->normal.x, R(0.5) - R(0.5) * s->normal.y, R(0.5) - R(0.5) * s->normal.z};
}
