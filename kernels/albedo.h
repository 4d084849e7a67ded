// The blended colour itself.
static inline reals3 shade_surface(const Surface *s, constant Shading *shading, constant PhongLight *lights)
{
  return s->albedo;
}
