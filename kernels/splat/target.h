// Provides to_target, which rounds sums and products to the format of an older render target ([BHZK05] figure 2).
//
// Values of unorm8 are in units of 1/255. The format has no sign, so a normal n is stored as (1 + n) / 2.
//
// TARGET  FLOAT16, FLOAT16_CLAMPED, UNORM8 or FLOAT32; 0: sums keep the precision of a real

#include "arithmetic/reals.h"

#define FLOAT16 1
#define UNORM8 2
#define FLOAT32 3
#define FLOAT16_CLAMPED 4

#if TARGET == UNORM8
#define UNITS R(255.0)
#else
#define UNITS R(1.0)
#endif

#if DOUBLE
typedef long8 bits8;
#define AS_BITS8(x) as_long8(x)
#define AS_REAL8(x) as_double8(x)
#define HALF_UNIT 268435456.0  // adding and subtracting it rounds to a multiple of 2^-24
#else
typedef int8 bits8;
#define AS_BITS8(x) as_int8(x)
#define AS_REAL8(x) as_float8(x)
#define HALF_UNIT 0.5f
#endif

// Round the significand to `kept` bits, ties to even.
static inline real8 shorter(real8 x, int kept)
{
  const bits8 b = AS_BITS8(x);
  const bits drop = MANTISSA - kept;
  const bits8 odd = (b >> drop) & (bits8)1;
  return AS_REAL8((b + ((bits8)(((bits)1 << (drop - 1)) - 1) + odd)) & (bits8)(-((bits)1 << drop)));
}

#if TARGET == FLOAT16 || TARGET == FLOAT16_CLAMPED
// A sum that overflows is infinite, or with FLOAT16_CLAMPED the format's greatest number.
static inline real8 to_target(real8 x)
{
  const bits8 sign = AS_BITS8(x) & (bits8)SIGN_BIT;
  const real8 size = AS_REAL8(AS_BITS8(x) & ~(bits8)SIGN_BIT);
  const real8 subnormal = (size + HALF_UNIT) - HALF_UNIT;
  const real8 normal = shorter(size, 10);
  const real8 rounded = size < (real8)R(6.103515625e-05) ? subnormal : normal;
#if TARGET == FLOAT16
  // The sum of infinities of both signs is NaN, whose bits depend on the device; it is replaced by one NaN.
  const real8 most = (real8)(real)INFINITY;
  const real8 signed8 = AS_REAL8(AS_BITS8(rounded < (real8)R(65520.0) ? rounded : most) | sign);
  return size == size ? signed8 : AS_REAL8(AS_BITS8(most) | (bits8)((bits)1 << (MANTISSA - 1)));
#else
  const real8 most = (real8)R(65504.0);
  return AS_REAL8(AS_BITS8(rounded < most ? rounded : most) | sign);
#endif
}
#elif TARGET == UNORM8
// Clamp to [0, 1] and round to the nearest unit, halves up.
static inline real8 to_target(real8 x)
{
  const real8 positive = x > (real8)R(0.0) ? x : (real8)R(0.0);
  const real8 clamped = positive < (real8)UNITS ? positive : (real8)UNITS;
  const real8 whole = (clamped + ROUND_MAGIC) - ROUND_MAGIC, below = whole > clamped ? whole - R(1.0) : whole;
  return clamped - below >= (real8)R(0.5) ? below + R(1.0) : below;
}
#elif TARGET == FLOAT32
// In halves: LLVM 14 cannot compile eight conversions at once for AVX-512.
static inline real8 to_target(real8 x)
{
  return (real8)(convert_double4(convert_float4(x.lo)), convert_double4(convert_float4(x.hi)));
}
#endif
