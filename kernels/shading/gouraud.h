// Provides Gouraud shading: forward shading at the splats' centers.
//
// SHADING, SHADER  as in splat/extra.h and shading/forward.h

#include "arithmetic/vectors.h"
#include "splat/extra.h"
#include "projection/record.h"
#include "shading/surface.h"
#include "shading/forward.h"

#if SHADING == PER_SPLAT
#define SPLAT_LIGHT_PARAMETERS FORWARD_PARAMETERS

// The splats' colors, shaded at their centers ([BK03]).
static inline reals3 gouraud_color(const projected *s, reals3 color, constant Shading *shading,
                                   constant PhongLight *lights)
{
  const reals3 normal = {s->normal_x, s->normal_y, s->normal_z};
  const surfaces p = surface_point(s->center, s->center, normal, color, &s->extra, shading);
  return shade_surface(&p, shading, lights);
}
#else
#define SPLAT_LIGHT_PARAMETERS
#endif
