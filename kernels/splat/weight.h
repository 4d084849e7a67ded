// Provides the weight of a fragment by its radius r in [0, 1].
//
// KERNEL  GAUSSIAN, CONSTANT, or a table: its nearest sample or linear interpolation

#include "arithmetic/reals.h"
#include "arithmetic/divide.h"
#include "arithmetic/exponential.h"

#define GAUSSIAN 0
#define CONSTANT 1
#define TABLE_NEAREST 2
#define TABLE_LINEAR 3

// The Gaussian is exp(r^2 falloff) with falloff = -cutoff^2 / 2.
static inline reals weight_of(reals r2, real falloff, constant real *table, int table_size)
{
#if KERNEL == GAUSSIAN
  return exp_negative(r2 * falloff);
#elif KERNEL == CONSTANT
  return (reals)R(1.0);
#else
  const reals place = square_root(at_most(at_least(r2, R(0.0)), R(1.0))) * (real)(table_size - 1);
  reals weight;
  for (int lane = 0; lane < LANES; ++lane) {
    const real x = ((const real *)&place)[lane];
#if KERNEL == TABLE_NEAREST
    ((real *)&weight)[lane] = table[(int)(x + R(0.5))];
#else
    const int below = min((int)x, table_size - 2);
    const real t = x - (real)below;
    ((real *)&weight)[lane] = table[below] * (R(1.0) - t) + table[below + 1] * t;
#endif
  }
  return weight;
#endif
}
