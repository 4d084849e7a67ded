// Splats and fragments that are lit before they are blended. Needs arithmetic.h, extra.h and the build option SHADER.

#include "arithmetic/reals.h"
#include "arithmetic/vectors.h"
#include "splat/extra.h"
#include "shading/surface.h"
#include SHADER

#define FORWARD_PARAMETERS , constant Shading *shading, constant PhongLight *lights

// What stands where a splat has no specular coefficient or shininess of its own, which is then NaN.
static inline reals own_or(reals own, reals other) { return SELECT(other, own, MASK(own == own)); }

// A point of a splat itself, on a ray d; `gloss` are its own specular coefficient and shininess.
static inline surfaces surface_point(reals3 position, reals3 d, reals3 normal, reals3 color, const extras *gloss,
                                    constant Shading *shading)
{
  surfaces s;
  s.covered = (masks)-1;
  s.position = position;
  s.normal = normal;
  s.albedo = color;
  s.to_eye = toward_eye(d, s.covered);
  s.specular = (reals)shading->specular;
  s.shininess = (reals)shading->shininess;
#if GLOSS
  s.specular = own_or(gloss->specular, s.specular);
  s.shininess = own_or(gloss->shininess, s.shininess);
#endif
  return s;
}
