// The doctor: apply each operation that the kernels rest on to given numbers. The host compares the results with
// NumPy's.
//
// No product is used twice, so a compiler that contracts or rearranges has every reason to do so here.
//
// ROW_name  the row of the results of operation `name`
// FMA       1: fma alone (no kernel uses it, and a runtime may fail to build it), 0: all other operations

#include "arithmetic/reals.h"
#include "arithmetic/exact.h"
#include "arithmetic/divide.h"
#include "arithmetic/vectors.h"

#define NUMBERS_PER_ITEM 512
#define RESULT_BITS(name, value) store_lanes(results + (long)ROW_##name * count + i, value)
#define RESULT(name, value) store_lanes(results + (long)ROW_##name * count + i, AS_BITS((reals)(value)))

#if LANES == 1
static inline reals load_lanes(global const real *place) { return *place; }
static inline void store_lanes(global bits *place, masks value) { *place = value; }
#else
static inline reals load_lanes(global const real *place) { return PASTE(vload, LANES)(0, place); }
static inline void store_lanes(global bits *place, masks value) { PASTE(vstore, LANES)(value, 0, place); }
#endif

#if !FMA
static inline void arithmetic(reals a, reals b, reals c, reals d, global bits *results, int count, int i)
{
  const reals3 p = {b, c, d}, q = {d, d, d};
  RESULT(add, a + b);
  RESULT(subtract, a - b);
  RESULT(negate, -a);
  RESULT(multiply, a * b);
  RESULT(divide, divide(a, b));
  RESULT(reciprocal, divide(R(1.0), a));
  RESULT(square_root, square_root(a));
  RESULT(multiply_add, a * c + b);
  RESULT(multiply_subtract, b * c - a);
  RESULT(subtract_product, c - a * d);
  RESULT(sum, (b + c) + d);
  RESULT(dot, dot3(p, q));
  RESULT(rounding_of_sum, two_sum(a, b).lo);
  RESULT(rounding_of_product, two_product(a, b).lo);
  RESULT(round_even, round_even(a));
}

static inline void decisions(reals a, reals b, reals c, reals d, global bits *results, int count, int i)
{
  RESULT_BITS(less, MASK(a < b));
  RESULT_BITS(less_equal, MASK(a <= b));
  RESULT_BITS(greater, MASK(a > b));
  RESULT_BITS(greater_equal, MASK(a >= b));
  RESULT_BITS(any, (masks)(ANY(MASK(a < b) & MASK(c < d)) ? -1 : 0));
  RESULT(select, SELECT(a, b, MASK(c < d)));
  RESULT(at_least, at_least(a, b));
  RESULT(at_most, at_most(a, b));
  RESULT(magnitude, magnitude(a));
}

static inline void bit_patterns(reals a, reals b, global bits *results, int count, int i)
{
  masks to_int;
  reals from_bits;
  for (int lane = 0; lane < LANES; ++lane) {
    ((bits *)&to_int)[lane] = (int)((const real *)&a)[lane];
    ((real *)&from_bits)[lane] = (real)((const bits *)&b)[lane];
  }
  RESULT_BITS(to_int, to_int);
  RESULT(from_bits, from_bits);
  RESULT_BITS(shift_right, AS_BITS(a) >> (bits)MANTISSA);
  RESULT_BITS(shift_left, AS_BITS(a) << (bits)8);
  RESULT_BITS(bit_difference, AS_BITS(a) - AS_BITS(b));
  RESULT_BITS(bit_and, AS_BITS(a) & ~AS_BITS(b));
}
#endif

// numbers: a, b, c and d, `count` of each.
kernel void doctor(global const real *numbers, global bits *results, const int count)
{
  const int begin = get_global_id(0) * NUMBERS_PER_ITEM;
  for (int i = begin; i < begin + NUMBERS_PER_ITEM; i += LANES) {
    const reals a = load_lanes(numbers + i), b = load_lanes(numbers + count + i);
    const reals c = load_lanes(numbers + 2 * (long)count + i), d = load_lanes(numbers + 3 * (long)count + i);
#if FMA
    RESULT(fma, fma(a, b, -(a * b)));
#else
    arithmetic(a, b, c, d, results, count, i);
    decisions(a, b, c, d, results, count, i);
    bit_patterns(a, b, results, count, i);
#endif
  }
}
