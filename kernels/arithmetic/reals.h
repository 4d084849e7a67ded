// Provides the types real, reals and masks, and their selects, bounds and roundings.
//
// The strict arithmetic profile: each operation is correctly rounded, and the order of operations is fixed. So every
// OpenCL runtime computes the same bits. The kernels use only + - *, divide and square_root (divide.h), comparisons,
// selects and bit casts.
//
// LANES   pixels or splats in one value: 1, 4, 8 or 16
// DOUBLE  0: float, 1: double

#ifndef LANES
#error "build option LANES is missing: 1, 4, 8 or 16"
#endif
#ifndef DOUBLE
#error "build option DOUBLE is missing: 0 for float, 1 for double"
#endif

#define PASTE_(a, b) a##b
#define PASTE(a, b) PASTE_(a, b)

#if DOUBLE
#pragma OPENCL EXTENSION cl_khr_fp64 : enable
typedef double real;
typedef double8 real8;
typedef long bits;  // an integer of the width of a real
#define R(x) x      // a literal
#define MANTISSA 52
#define EXPONENT_BIAS 1023
#define SPLIT_MASK 0xfffffffff8000000L  // keeps the leading 26 bits of a significand ...
#define SPLIT_HALF 0x4000000L           // ... after rounding: the other 27 bits then fit in 26 and a sign
#else
typedef float real;
typedef float8 real8;
typedef int bits;
#define R(x) PASTE(x, f)
#define MANTISSA 23
#define EXPONENT_BIAS 127
#define SPLIT_MASK 0xfffff000  // keeps the leading 12 bits of a significand; 12 remain
#define SPLIT_HALF 0
#endif
#define SIGN_BIT ((bits)(DOUBLE ? LONG_MIN : INT_MIN))

// reals: LANES reals. masks: LANES integers of their width, each all ones or all zeros.
#if LANES == 1
typedef real reals;
typedef bits masks;
#define MASK(comparison) (-(bits)(comparison))
#define ANY(mask) ((mask) != 0)
#define SELECT(no, yes, mask) ((mask) ? (yes) : (no))
#define AS_BITS(x) PASTE(AS_BITS_, DOUBLE)(x)
#define AS_BITS_0(x) as_int(x)
#define AS_BITS_1(x) as_long(x)
#define AS_REALS(x) PASTE(AS_REALS_, DOUBLE)(x)
#define AS_REALS_0(x) as_float(x)
#define AS_REALS_1(x) as_double(x)
#else
#if DOUBLE
typedef PASTE(double, LANES) reals;
typedef PASTE(long, LANES) masks;
#define AS_BITS(x) PASTE(as_long, LANES)(x)
#define AS_REALS(x) PASTE(as_double, LANES)(x)
#else
typedef PASTE(float, LANES) reals;
typedef PASTE(int, LANES) masks;
#define AS_BITS(x) PASTE(as_int, LANES)(x)
#define AS_REALS(x) PASTE(as_float, LANES)(x)
#endif
#define MASK(comparison) (comparison)
#define SELECT(no, yes, mask) ((masks)(mask) ? (reals)(yes) : (reals)(no))

// any(), sixteen bytes at a time. PoCL 3.0 compiles any(), select(), min() and vload8() to calls. Such a call costs
// more than the operation itself, since no vector stays in a register across a call.
static inline int any_of(masks m)
{
#if LANES == 4 && !DOUBLE
  const long2 rest = as_long2(m);
#else
#if LANES == 16
  const long4 four = as_long8(m).lo | as_long8(m).hi;
#elif LANES == 8 && DOUBLE
  const long4 four = m.lo | m.hi;
#else
  const long4 four = as_long4(m);
#endif
  const long2 rest = four.lo | four.hi;
#endif
  return (rest.x | rest.y) != 0;
}
#define ANY(mask) any_of(mask)
#endif

// A comparison with NaN is false, so these replace a NaN by the bound.
static inline reals at_least(reals x, reals low) { return SELECT(low, x, MASK(x > low)); }
static inline reals at_most(reals x, reals high) { return SELECT(high, x, MASK(x < high)); }
static inline reals magnitude(reals x) { return AS_REALS(AS_BITS(x) & ~SIGN_BIT); }

static inline real magnitude_of(real x) { return x < R(0.0) ? -x : x; }

static inline int least(int a, int b) { return a < b ? a : b; }

// The nearest integer, ties to even: a sum with 1.5 * 2^MANTISSA has no fraction bits. (Some runtimes call rint.)
#define ROUND_MAGIC ((real)(3L << (MANTISSA - 1)))
static inline reals round_even(reals x)
{
  reals rounded = (x + ROUND_MAGIC) - ROUND_MAGIC;
  return SELECT(x, rounded, MASK(magnitude(x) < (real)(1L << (MANTISSA - 1))));
}

// Convert small whole numbers to integers, and back.
static inline masks whole_of(reals x) { return AS_BITS(x + ROUND_MAGIC) - AS_BITS((reals)(ROUND_MAGIC)); }
static inline reals real_of(masks i) { return AS_REALS(i + AS_BITS((reals)(ROUND_MAGIC))) - ROUND_MAGIC; }

// The next whole number at or above x, and at or below it, for -1 <= x < 2^(MANTISSA - 2). (ceil and floor are calls
// too.)
static inline reals round_up(reals x)
{
  const reals whole = (x + ROUND_MAGIC) - ROUND_MAGIC;
  return SELECT(whole, whole + R(1.0), MASK(whole < x));
}

static inline reals round_down(reals x)
{
  const reals whole = (x + ROUND_MAGIC) - ROUND_MAGIC;
  return SELECT(whole, whole - R(1.0), MASK(whole > x));
}
