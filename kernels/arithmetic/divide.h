// Provides divide(a, b) and square_root(x), correctly rounded, and divide_real and square_root_real for a single real.
//
// OpenCL does not require correct rounding of either. Where the runtime rounds correctly, these are its own operations.
// Elsewhere they consist of + - * and bit casts alone.
//
// ON_POCL       1 on PoCL, whose sqrt of a vector is a call, else 0
// EXACT_DIVIDE  1: the runtime's division is correctly rounded, as the device's arithmetic test finds; 0: not
// EXACT_SQRT    the same of its square root

#include "arithmetic/reals.h"
#include "arithmetic/exact.h"

#ifndef ON_POCL
#error "build option ON_POCL is missing: 1 on PoCL, else 0"
#endif
#if !defined EXACT_DIVIDE || !defined EXACT_SQRT
#error "build options EXACT_DIVIDE and EXACT_SQRT are missing: 1 where the runtime rounds correctly, else 0"
#endif

#if LANES == 1
#define FIRST_LANE(x) (x)
#else
#define FIRST_LANE(x) ((x).s0)
#endif

// Our own operations are long, so they are called rather than inlined. (No function takes sixteen lanes.)
#if LANES < 16
#define CALLED static __attribute__((noinline))
#else
#define CALLED static inline
#endif

#if EXACT_DIVIDE
#define divide(a, b) ((a) / (b))
#define divide_real(a, b) ((a) / (b))
#else
CALLED reals divide_plainly(reals a, reals b);
#define divide(a, b) divide_plainly((reals)(a), (reals)(b))
#define divide_real(a, b) FIRST_LANE(divide(a, b))
#endif

#if EXACT_SQRT
#if ON_POCL && LANES == 8 && !DOUBLE && defined(__AVX__)
// The instruction inside PoCL's sqrt, without the call (docs/speed/performance.md).
typedef float gnu_float8 __attribute__((vector_size(32)));
#define square_root(x) as_float8(__builtin_ia32_sqrtps256(__builtin_astype((reals)(x), gnu_float8)))
#else
#define square_root(x) sqrt(x)
#endif
#define square_root_real(x) sqrt(x)
#else
CALLED reals square_root_plainly(reals x);
#define square_root(x) square_root_plainly((reals)(x))
#define square_root_real(x) FIRST_LANE(square_root(x))
#endif

#if !EXACT_DIVIDE || !EXACT_SQRT

#define FRACTION_BITS (((bits)1 << MANTISSA) - 1)
#define ULP (DOUBLE ? R(0x1p-52) : R(0x1p-23))  // of numbers in [1, 2), the range of quotients and roots
#define NEWTON_STEPS (DOUBLE ? 4 : 3)

// For finite x > 0: x = significand * 2^exponent with 1 <= significand < 2.
typedef struct {
  reals significand;
  masks exponent;
} parts;

static inline parts split_exponent(reals x)
{
  const masks subnormal = MASK(x < AS_REALS((masks)((bits)1 << MANTISSA)));
  const masks b = AS_BITS(SELECT(x, x * (real)(1L << MANTISSA), subnormal));
  parts p = {AS_REALS((b & FRACTION_BITS) | ((bits)EXPONENT_BIAS << MANTISSA)),
             (b >> (bits)MANTISSA) - (bits)EXPONENT_BIAS - (subnormal & (bits)MANTISSA)};
  return p;
}

static inline reals power_of_two(masks e) { return AS_REALS((e + (bits)EXPONENT_BIAS) << (bits)MANTISSA); }

// x * 2^exponent in two steps, since the exponent may be twice a real's; a subnormal result is rounded a second time.
static inline reals join_exponent(reals x, masks exponent)
{
  const bits widest = 2 * (EXPONENT_BIAS - 1);
  exponent = clamp(exponent, (masks)-widest, (masks)widest);
  const masks half_way = exponent >> (bits)1;
  return x * power_of_two(half_way) * power_of_two(exponent - half_way);
}

// n - a b: exact near the decisions below, where a b lies within a few ulp of n.
static inline reals remainder_of(reals n, reals a, reals b)
{
  const twofloat p = two_product(a, b);
  return (n - p.hi) - p.lo;
}

static inline reals within_binade(reals x) { return at_most(at_least(x, R(1.0)), R(2.0) - ULP); }

// The next real above q where `up`, below q where `down`.
static inline reals step_ulp(reals q, masks up, masks down)
{
  return q + SELECT(SELECT(R(0.0), -ULP, down), ULP, up);
}
#endif

#if !EXACT_DIVIDE
// n / m in [1, 2): Newton's iteration for 1 / m, one step for the quotient, then the neighbor with a remainder of at
// most half an ulp. (The quotient of two reals is never half-way between two reals.)
static inline reals quotient(reals n, reals m)
{
  reals inverse = R(1.4117647058823528) - m * R(0.47058823529411764);  // within 1/17
  for (int step = 0; step < NEWTON_STEPS; ++step) inverse = inverse + inverse * (R(1.0) - m * inverse);
  reals q = within_binade(n * inverse);
  q = within_binade(q + remainder_of(n, q, m) * inverse);
  const reals remainder = remainder_of(n, q, m), half_ulp = m * (R(0.5) * ULP);
  return step_ulp(q, MASK(remainder > half_ulp), MASK(remainder < -half_ulp));
}

CALLED reals divide_plainly(reals a, reals b)
{
  const masks sign = (AS_BITS(a) ^ AS_BITS(b)) & SIGN_BIT;
  const masks is_nan = MASK(a != a) | MASK(b != b);
  a = AS_REALS(AS_BITS(a) & ~SIGN_BIT);
  b = AS_REALS(AS_BITS(b) & ~SIGN_BIT);
  const masks a_zero = MASK(a == R(0.0)), a_infinite = MASK(a == (real)INFINITY);
  const masks b_zero = MASK(b == R(0.0)), b_infinite = MASK(b == (real)INFINITY);
  const parts n = split_exponent(a), m = split_exponent(b);
  const masks below = MASK(n.significand < m.significand);
  const reals numerator = SELECT(n.significand, R(2.0) * n.significand, below);
  reals q = join_exponent(quotient(numerator, m.significand), n.exponent - m.exponent + below);  // set: -1
  q = SELECT(q, R(0.0), a_zero | b_infinite);
  q = SELECT(q, (real)INFINITY, a_infinite | b_zero);
  q = SELECT(q, (real)NAN, is_nan | (a_zero & b_zero) | (a_infinite & b_infinite));
  return AS_REALS(AS_BITS(q) | sign);
}
#endif

#if !EXACT_SQRT
// sqrt(m) in [1, 2) for m in [1, 4): Newton's iteration for 1 / sqrt(m) from a shift of its bits, one step for the
// root, then the neighbor r with (r - ulp/2)^2 < m < (r + ulp/2)^2. All terms are multiples of ulp^2, so ulp^2/4 drops
// out.
static inline reals root(reals m)
{
  const bits seed = DOUBLE ? (bits)0x5fe6eb50c7b537a9L : (bits)0x5f3759df;
  reals inverse = AS_REALS(seed - (AS_BITS(m) >> (bits)1));  // within 1/28
  for (int step = 0; step < NEWTON_STEPS; ++step)
    inverse = inverse * (R(1.5) - R(0.5) * m * (inverse * inverse));
  reals r = within_binade(m * inverse);
  r = within_binade(r + remainder_of(m, r, r) * (R(0.5) * inverse));
  const reals remainder = remainder_of(m, r, r), edge = r * ULP;
  return step_ulp(r, MASK(remainder > edge), MASK(remainder <= -edge));
}

CALLED reals square_root_plainly(reals x)
{
  const parts p = split_exponent(x);
  const masks odd = p.exponent & (bits)1;
  const reals m = p.significand * power_of_two(odd);
  reals r = join_exponent(root(m), (p.exponent - odd) >> (bits)1);
  r = SELECT(r, x, MASK(x == R(0.0)) | MASK(x == (real)INFINITY) | MASK(x != x));
  return SELECT(r, (real)NAN, MASK(x < R(0.0)));
}
#endif
