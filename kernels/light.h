// A light as it arrives at LANES places. Needs surface.h.

typedef struct {
  reals3 toward;  // unit, toward the light
  reals3 color;
} Arriving;

static inline Arriving arriving(const Surface *s, constant PhongLight *light)
{
  const reals3 place = {light->x, light->y, light->z};
  Arriving a;
  a.toward = normalize3(light->is_point > R(0.0) ? add3(place, scale3(s->position, R(-1.0))) : place);
  a.color.x = (reals)light->red;
  a.color.y = (reals)light->green;
  a.color.z = (reals)light->blue;
  return a;
}
