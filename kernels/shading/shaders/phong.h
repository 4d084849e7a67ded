// Provides the shader phong: color = albedo (ambient + diffuse sum N.L) + specular sum (R.V)^shininess.
//
// Lights are in eye space. A light behind the surface, N.L <= 0, adds nothing.

#include "arithmetic/reals.h"
#include "arithmetic/vectors.h"
#include "arithmetic/exponential.h"
#include "shading/surface.h"
#include "shading/light.h"

static inline reals3 shade_surface(const surfaces *s, constant Shading *shading, constant PhongLight *lights)
{
  reals3 color = scale3(s->albedo, shading->ambient);
  for (int i = 0; i < shading->num_lights; ++i) {
    const reals3 to_light = toward_light(s, lights + i);
    const reals n_l = dot3(s->normal, to_light);
    const masks lit = MASK(n_l > R(0.0));
    if (!ANY(lit)) continue;
    const reals3 tint = light_tint(s, lights + i, to_light);
    const reals3 diffuse = scale3(tint, n_l * shading->diffuse);
    reals3 sum = add3(color, (reals3){diffuse.x * s->albedo.x, diffuse.y * s->albedo.y, diffuse.z * s->albedo.z});
    const reals3 mirrored = add3(scale3(s->normal, R(2.0) * n_l), scale3(to_light, R(-1.0)));
    const reals shine = power(at_most(dot3(mirrored, s->to_eye), R(1.0)), s->shininess);
    sum = add3(sum, scale3(tint, s->specular * shine));
    color = select3(color, sum, lit);
  }
  return color;
}
