// One splat's fragment at one block of pixels, and what accumulating it adds: written once, used by the attribute
// pass and by whatever explains or checks it. Needs arithmetic.h, ray.h and splat.h.

typedef struct {
  reals weight, red, green, blue, normal_x, normal_y, normal_z, z;
  uints count;
} sums;

typedef struct {
  reals r2, z;
  masks exists;
} fragment;

// r2^2, whatever the setting of the pre-filter.
static inline reals screen_radius2(const SplatAttributes *a, const hit *h, real inverse_radius2)
{
  const reals x = h->dx - a->prefilter_x, y = h->dy - a->prefilter_y;
  return (x * x + y * y) * inverse_radius2;
}

// r^2 = min(r3^2, r2^2); where only the pre-filter accepts, the depth is the centre's.
static inline fragment filter(const ProjectedSplat *s, const SplatAttributes *a, const hit *h, real near, real far,
                              real inverse_radius2)
{
  fragment f;
  const reals inverse_den = divide(R(1.0), h->den);
  f.z = hit_depth(s, h, inverse_den);
  f.exists = h->inside & MASK(f.z >= near) & MASK(f.z <= far);
  f.r2 = at_most(h->numerator * (inverse_den * inverse_den), R(1.0));
#if PREFILTER
  const reals screen_r2 = screen_radius2(a, h, inverse_radius2);
  f.r2 = SELECT(screen_r2, f.r2, f.exists & MASK(f.r2 < screen_r2));
  f.z = SELECT(a->center_z, f.z, f.exists);
  f.exists |= MASK(screen_r2 <= R(1.0));
#endif
  return f;
}

static inline void accumulate(sums *t, const SplatAttributes *a, const fragment *f, masks accepted, reals weight)
{
  weight = SELECT(R(0.0), weight, accepted);  // adding zero leaves a sum's bits as they are
  t->weight += weight;
  t->red += weight * a->red;
  t->green += weight * a->green;
  t->blue += weight * a->blue;
  t->normal_x += weight * a->normal_x;
  t->normal_y += weight * a->normal_y;
  t->normal_z += weight * a->normal_z;
  t->z += weight * SELECT(R(0.0), f->z, accepted);
  t->count -= UINT_MASK(accepted);
}

// depth(p) + epsilon; epsilon along a perspective ray is shorter along z.
static inline real farthest_accepted(constant View *view, int x, int y, real depth, real epsilon, int along_ray)
{
  if (ORTHOGRAPHIC || !along_ray) return depth + epsilon;
  const real dx = ray_x(view, x), dy = ray_y(view, y);
  return depth + divide_real(epsilon, square_root_real((dx * dx + dy * dy) + R(1.0)));
}
