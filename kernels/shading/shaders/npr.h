// Provides the shader npr: flat tones between lines.
//
// The diffuse light selects a tone. A line is drawn where a neighbor has no surface or its depth differs by more than
// `contour` (contours), and where N.V < `silhouette`.

#include "arithmetic/reals.h"
#include "arithmetic/vectors.h"
#include "arithmetic/lanes.h"
#include "shading/surface.h"
#include "shading/gbuffer.h"
#include "shading/light.h"

#define TAKES_PIXELS

static inline reals tone_of(reals light, constant real *tones, int num_tones)
{
  const reals place = at_least(at_most(light, R(1.0)), R(0.0)) * (real)num_tones;
  const masks i = whole_of(at_most(round_down(place), (reals)(real)(num_tones - 1)));
#define TONE(lane, i) tones[WHOLE_OF(i, lane)]
  return (reals)EACH_LANE(TONE, i);
#undef TONE
}

static inline masks on_line(const surfaces *s, const Pixels *at, constant Npr *npr)
{
  masks line = MASK(dot3(s->normal, s->to_eye) < npr->silhouette);
  for (int dy = -1; dy <= 1; ++dy)
    for (int dx = -1; dx <= 1; ++dx)
      line |= MASK(magnitude(depths_at(at, dx, dy) - s->position.z) > npr->contour);
  return line;
}

static inline reals3 shade_pixels(const surfaces *s, constant Shading *shading, constant PhongLight *lights,
                                  const Pixels *at, constant Npr *npr, constant real *tones)
{
  reals3 light = {R(0.0), R(0.0), R(0.0)};
  for (int i = 0; i < shading->num_lights; ++i) {
    const Arriving a = arriving(s, lights + i);
    light = add3(light, scale3(a.color, at_least(dot3(s->normal, a.toward), R(0.0))));
  }
  const reals3 color = {s->albedo.x * tone_of(light.x, tones, npr->num_tones),
                        s->albedo.y * tone_of(light.y, tones, npr->num_tones),
                        s->albedo.z * tone_of(light.z, tones, npr->num_tones)};
  const reals3 ink = {(reals)npr->red, (reals)npr->green, (reals)npr->blue};
  return select3(color, ink, on_line(s, at, npr));
}
