// Provides the transformation from world to eye space, of centers in twice the precision.
//
// CENTER_LOW  1: centers have a low word, 0: not

#include "arithmetic/reals.h"
#include "arithmetic/exact.h"
#include "arithmetic/vectors.h"
#include "arithmetic/twofloat.h"

// Values of View.facing: how a splat that faces away from the eye is treated.
#define KEEP 0
#define FLIP 1
#define CULL 2

// Values of View.prefilter_center.
#define AT_CENTER 0
#define AT_BOUNDS 1
#define AT_PARALLELOGRAM 2

typedef struct {
  twofloat x, y, z;
} eye_point;

static inline twofloat eye_coordinate(reals3 world, reals3 world_low, twofloat r0, twofloat r1, twofloat r2, twofloat t)
{
  twofloat p0 = two_product(r0.hi, world.x), p1 = two_product(r1.hi, world.y), p2 = two_product(r2.hi, world.z);
  twofloat s1 = two_sum(p0.hi, p1.hi), s2 = two_sum(s1.hi, p2.hi), s3 = two_sum(s2.hi, t.hi);
  reals low = (r0.lo * world.x + r1.lo * world.y) + r2.lo * world.z;
#if CENTER_LOW
  low = low + ((r0.hi * world_low.x + r1.hi * world_low.y) + r2.hi * world_low.z);
#endif
  low = low + ((p0.lo + p1.lo) + p2.lo) + ((s1.lo + s2.lo) + s3.lo) + t.lo;
  return two_sum(s3.hi, low);
}

// A field of View to twice the precision.
#define TWO(name) ((twofloat){(reals)(view->name##_hi), (reals)(view->name##_lo)})

static inline eye_point eye_from_world(constant View *view, reals3 world, reals3 world_low)
{
  eye_point p = {eye_coordinate(world, world_low, TWO(r00), TWO(r01), TWO(r02), TWO(t0)),
                 eye_coordinate(world, world_low, TWO(r10), TWO(r11), TWO(r12), TWO(t1)),
                 eye_coordinate(world, world_low, TWO(r20), TWO(r21), TWO(r22), TWO(t2))};
  return p;
}

// A tangent in twice the precision. Tangents have no low word, and a translation does not change them.
static inline eye_point rotate_twofloat(constant View *view, reals3 v)
{
  const reals3 none = {R(0.0), R(0.0), R(0.0)};
  const twofloat zero = {R(0.0), R(0.0)};
  eye_point r = {eye_coordinate(v, none, TWO(r00), TWO(r01), TWO(r02), zero),
                 eye_coordinate(v, none, TWO(r10), TWO(r11), TWO(r12), zero),
                 eye_coordinate(v, none, TWO(r20), TWO(r21), TWO(r22), zero)};
  return r;
}

// A tangent, or the direction of a normal, in plain precision.
static inline reals3 rotate(constant View *view, reals3 v)
{
  reals3 r = {(view->r00_hi * v.x + view->r01_hi * v.y) + view->r02_hi * v.z,
              (view->r10_hi * v.x + view->r11_hi * v.y) + view->r12_hi * v.z,
              (view->r20_hi * v.x + view->r21_hi * v.y) + view->r22_hi * v.z};
  return r;
}

static inline twofloat two_determinant(twofloat a, twofloat b, twofloat c, twofloat d)  // a b - c d
{
  twofloat p = two_multiply(a, b), q = two_multiply(c, d);
  return two_add(p, (twofloat){-q.hi, -q.lo});
}

static inline eye_point two_cross(eye_point a, eye_point b)
{
  eye_point c = {two_determinant(a.y, b.z, a.z, b.y), two_determinant(a.z, b.x, a.x, b.z),
                 two_determinant(a.x, b.y, a.y, b.x)};
  return c;
}

static inline twofloat two_step(twofloat start, reals u, twofloat tu, reals v, twofloat tv)  // start + u tu + v tv
{
  const twofloat u2 = {u, R(0.0)}, v2 = {v, R(0.0)};
  return two_add(two_add(start, two_multiply(u2, tu)), two_multiply(v2, tv));
}
