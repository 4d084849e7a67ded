// Provides arithmetic in twice the precision, on unevaluated sums of two reals (Dekker 1971).
//
// The projected center needs it: rounding c to a float moves it by 5e-5 pixels at pixel 512, and every r with it.

#include "arithmetic/reals.h"
#include "arithmetic/exact.h"
#include "arithmetic/divide.h"

static inline twofloat two_add(twofloat a, twofloat b)
{
  twofloat s = two_sum(a.hi, b.hi);
  return two_sum(s.hi, s.lo + (a.lo + b.lo));
}

static inline twofloat two_multiply(twofloat a, twofloat b)
{
  twofloat p = two_product(a.hi, b.hi);
  return two_sum(p.hi, p.lo + (a.hi * b.lo + a.lo * b.hi));
}

static inline twofloat two_divide(twofloat a, twofloat b)
{
  reals inverse = divide(R(1.0), b.hi);
  reals q = a.hi * inverse;
  twofloat p = two_product(q, b.hi);
  reals remainder = (((a.hi - p.hi) - p.lo) + a.lo) - q * b.lo;
  return two_sum(q, remainder * inverse);
}
