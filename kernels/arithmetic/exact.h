// Provides sums and products without rounding error.

#include "arithmetic/reals.h"

typedef struct { reals hi, lo; } twofloat;

static inline twofloat two_sum(reals a, reals b)  // exact: a + b = hi + lo (Knuth)
{
  reals s = a + b;
  reals t = s - a;
  twofloat r = {s, (a - (s - t)) + (b - t)};
  return r;
}

static inline twofloat two_product(reals a, reals b)  // exact: a * b = hi + lo; split, since fma is slow on some CPUs
{
  reals a1 = AS_REALS((AS_BITS(a) + (bits)SPLIT_HALF) & (bits)SPLIT_MASK), a2 = a - a1;
  reals b1 = AS_REALS((AS_BITS(b) + (bits)SPLIT_HALF) & (bits)SPLIT_MASK), b2 = b - b1;
  reals p = a * b;
  twofloat r = {p, ((a1 * b1 - p) + a1 * b2 + a2 * b1) + a2 * b2};
  return r;
}
