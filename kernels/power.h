// x^s for 0 <= x <= 1, s >= 0. Needs arithmetic.h, LANES 1.

// ln x = e ln2 + 2 artanh f, f = (m - 1) / (m + 1), with x = 2^e m and m in [sqrt(1/2), sqrt(2))
static inline real log_positive(real x)
{
  bits e = (AS_BITS(x) >> MANTISSA) - EXPONENT_BIAS;
  real m = AS_REALS((AS_BITS(x) & (((bits)1 << MANTISSA) - 1)) | ((bits)EXPONENT_BIAS << MANTISSA));
  if (m > R(1.4142135623730951)) {
    m = m * R(0.5);
    e = e + 1;
  }
  const real f = divide(m - R(1.0), m + R(1.0)), f2 = f * f;
  real series = R(0.0);
  for (int k = DOUBLE ? 21 : 9; k >= 1; k -= 2) series = series * f2 + divide(R(1.0), (real)k);
  return (real)e * R(0.6931471805599453) + R(2.0) * f * series;
}

static inline real power(real x, real s)
{
  if (s == R(0.0)) return R(1.0);
  if (!(x > R(1e-30))) return R(0.0);
  const real exponent = s * log_positive(x);
  return exponent < R(-80.0) ? R(0.0) : exp_negative(exponent < R(0.0) ? exponent : R(0.0));
}
