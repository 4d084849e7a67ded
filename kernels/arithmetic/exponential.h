// Provides exp_negative, e^x, and power, x^s, from the strict operations alone.

#include "arithmetic/reals.h"
#include "arithmetic/divide.h"

// e^x for -80 <= x <= 0, to about one unit in the last place: x = n ln2 + f, |f| <= ln2/2, Taylor series in f.
static inline reals exp_negative(reals x)
{
  reals shifted = x * R(1.4426950408889634) + ROUND_MAGIC;
  masks n = AS_BITS(shifted) - AS_BITS((reals)(ROUND_MAGIC));
  reals whole = shifted - ROUND_MAGIC;
#if DOUBLE
  reals f = (x - whole * 0.69314718036912382) - whole * 1.9082149292705877e-10;
  reals e = R(1.6059043836821613e-10);
  e = e * f + R(2.08767569878681e-09);
  e = e * f + R(2.505210838544172e-08);
  e = e * f + R(2.755731922398589e-07);
  e = e * f + R(2.7557319223985893e-06);
  e = e * f + R(2.48015873015873e-05);
  e = e * f + R(0.0001984126984126984);
#else
  reals f = (x - whole * 0.693359375f) - whole * -2.12194440e-4f;
  reals e = R(0.0001984126984126984);
#endif
  e = e * f + R(0.001388888888888889);
  e = e * f + R(0.008333333333333333);
  e = e * f + R(0.041666666666666664);
  e = e * f + R(0.16666666666666666);
  e = e * f + R(0.5);
  e = e * f + R(1.0);
  e = e * f + R(1.0);
  return e * AS_REALS((n + (bits)EXPONENT_BIAS) << (bits)MANTISSA);
}

// ln x = e ln2 + 2 artanh f with x = 2^e m, m in [sqrt(1/2), sqrt(2)) and f = (m - 1) / (m + 1).
static inline reals log_positive(reals x)
{
  masks e = (AS_BITS(x) >> (bits)MANTISSA) - (bits)EXPONENT_BIAS;
  reals m = AS_REALS((AS_BITS(x) & (((bits)1 << MANTISSA) - 1)) | ((bits)EXPONENT_BIAS << MANTISSA));
  const masks large = MASK(m > R(1.4142135623730951));
  m = SELECT(m, m * R(0.5), large);
  e = e - large;  // `large` is -1 where set
  const reals f = divide(m - R(1.0), m + R(1.0)), f2 = f * f;
  reals series = R(0.0);
  for (int k = DOUBLE ? 21 : 9; k >= 1; k -= 2) series = series * f2 + divide_real(R(1.0), (real)k);
  return real_of(e) * R(0.6931471805599453) + R(2.0) * f * series;
}

// x^s for 0 <= x <= 1, s >= 0; 0^0 = 1.
static inline reals power(reals x, reals s)
{
  const reals exponent = s * log_positive(x);
  const masks tiny = ~MASK(x > R(1e-30)) | MASK(exponent < R(-80.0));
  const reals result = SELECT(exp_negative(SELECT(R(0.0), exponent, MASK(exponent < R(0.0)))), R(0.0), tiny);
  return SELECT(result, R(1.0), MASK(s == R(0.0)));
}
