// Provides two_sum and two_product: the exact sum and product of two reals, each as an unevaluated sum of two reals.

#include "arithmetic/reals.h"

typedef struct { reals hi, lo; } twofloat;  // value = hi + lo, |lo| <= ulp(hi)/2

static inline twofloat two_sum(reals a, reals b)  // a + b = hi + lo (Knuth)
{
  reals s = a + b;
  reals t = s - a;
  twofloat r = {s, (a - (s - t)) + (b - t)};
  return r;
}

static inline twofloat two_product(reals a, reals b)  // a * b = hi + lo (Dekker); fma is slow on some CPUs
{
  reals a1 = AS_REALS((AS_BITS(a) + (bits)SPLIT_HALF) & (bits)SPLIT_MASK), a2 = a - a1;
  reals b1 = AS_REALS((AS_BITS(b) + (bits)SPLIT_HALF) & (bits)SPLIT_MASK), b2 = b - b1;
  reals p = a * b;
  twofloat r = {p, ((a1 * b1 - p) + a1 * b2 + a2 * b1) + a2 * b2};
  return r;
}
