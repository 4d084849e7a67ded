// Twice the precision by unevaluated sums (Dekker 1971): value = hi + lo, |lo| <= ulp(hi)/2.
// The projected centre needs it: a float's rounding of c moves it by 5e-5 pixels at 512, and every r with it.
// Part of arithmetic.h.

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
