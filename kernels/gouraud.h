// Splats lit at their centres. Needs arithmetic.h, projected.h, and of those who do so the build option SHADER.

#if SHADING == PER_SPLAT
#include "surface.h"
#include SHADER
#define LIGHTS , constant Shading *shading, constant PhongLight *lights

// The splats' colours, lit at their centres ([BK03]).
static inline reals3 lit_color(const projected *s, reals3 color, constant Shading *shading, constant PhongLight *lights)
{
  Surface p;
  p.position = s->center;
  p.normal.x = s->normal_x;
  p.normal.y = s->normal_y;
  p.normal.z = s->normal_z;
  p.albedo = color;
  p.to_eye.x = p.to_eye.y = R(0.0);
  p.to_eye.z = R(-1.0);
#if !ORTHOGRAPHIC
  p.to_eye = normalize3(scale3(s->center, R(-1.0)));
#endif
  p.specular = (reals)shading->specular;
  p.shininess = (reals)shading->shininess;
#if GLOSS
  p.specular = SELECT(p.specular, s->extra.specular, MASK(s->extra.specular == s->extra.specular));
  p.shininess = SELECT(p.shininess, s->extra.shininess, MASK(s->extra.shininess == s->extra.shininess));
#endif
  p.mean_depth = p.distance = s->center.z;
  p.covered = (masks)-1;
  return shade_surface(&p, shading, lights);
}
#else
#define LIGHTS
#endif
