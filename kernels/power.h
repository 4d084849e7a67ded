// x^s for 0 <= x <= 1, s >= 0. Needs arithmetic.h.

// ln x = e ln2 + 2 artanh f, f = (m - 1) / (m + 1), with x = 2^e m and m in [sqrt(1/2), sqrt(2))
static inline reals log_positive(reals x)
{
  masks e = (AS_BITS(x) >> (bits)MANTISSA) - (bits)EXPONENT_BIAS;
  reals m = AS_REALS((AS_BITS(x) & (((bits)1 << MANTISSA) - 1)) | ((bits)EXPONENT_BIAS << MANTISSA));
  const masks large = MASK(m > R(1.4142135623730951));
  m = SELECT(m, m * R(0.5), large);
  e = e - large;  // all ones are -1
  const reals f = divide(m - R(1.0), m + R(1.0)), f2 = f * f;
  reals series = R(0.0);
  for (int k = DOUBLE ? 21 : 9; k >= 1; k -= 2) series = series * f2 + divide_real(R(1.0), (real)k);
  return real_of(e) * R(0.6931471805599453) + R(2.0) * f * series;
}

static inline reals power(reals x, reals s)
{
  const reals exponent = s * log_positive(x);
  const masks tiny = ~MASK(x > R(1e-30)) | MASK(exponent < R(-80.0));
  const reals result = SELECT(exp_negative(SELECT(R(0.0), exponent, MASK(exponent < R(0.0)))), R(0.0), tiny);
  return SELECT(result, R(1.0), MASK(s == R(0.0)));
}
