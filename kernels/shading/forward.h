// Provides forward shading: the surface of a splat's own point, to be shaded before blending.
//
// SHADER  the header with shade_surface()

#include "arithmetic/reals.h"
#include "arithmetic/vectors.h"
#include "splat/extra.h"
#include "shading/surface.h"
#include SHADER

#define FORWARD_PARAMETERS , constant Shading *shading, constant PhongLight *lights

// A splat's own value, or `other` where the splat has none, which is NaN.
static inline reals own_or(reals own, reals other) { return SELECT(other, own, MASK(own == own)); }

// The surface at a splat's point on ray d; `gloss` holds the splat's own specular coefficient and shininess.
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
