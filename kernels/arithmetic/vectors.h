// Provides reals3, LANES vectors of three reals, and their operations in a fixed order.

#include "arithmetic/reals.h"
#include "arithmetic/divide.h"

typedef struct { reals x, y, z; } reals3;

static inline reals dot3(reals3 a, reals3 b) { return (a.x * b.x + a.y * b.y) + a.z * b.z; }

static inline reals3 cross3(reals3 a, reals3 b)
{
  reals3 c = {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
  return c;
}

static inline reals3 scale3(reals3 a, reals s)
{
  reals3 b = {a.x * s, a.y * s, a.z * s};
  return b;
}

static inline reals3 add3(reals3 a, reals3 b)
{
  reals3 c = {a.x + b.x, a.y + b.y, a.z + b.z};
  return c;
}

// v / |v|; a vector of length zero stays zero.
static inline reals3 normalize3(reals3 v)
{
  const reals length2 = dot3(v, v);
  return scale3(v, SELECT(R(0.0), divide(R(1.0), square_root(length2)), MASK(length2 > R(0.0))));
}
