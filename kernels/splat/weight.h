// Provides the weight of a fragment by its radius r in [0, 1].
//
// KERNEL         GAUSSIAN, CONSTANT, or a table: its nearest sample or linear interpolation
// TABLE_TEXTURE  0: the first sample is at 0 and the last at 1, 1: samples are texels, with centers half a step inside
// TABLE_OVER_R2  0: the samples have equal steps of r, 1: of r^2

#include "arithmetic/reals.h"
#include "arithmetic/divide.h"
#include "arithmetic/exponential.h"

#define GAUSSIAN 0
#define CONSTANT 1
#define TABLE_NEAREST 2
#define TABLE_LINEAR 3

#if KERNEL == TABLE_NEAREST || KERNEL == TABLE_LINEAR
// The place in the table, in samples from the first. n t - 1/2 is exact wherever the clamps keep it, so the nearest texel
// is floor(n t).
static inline reals table_place(reals r2, int table_size)
{
  const reals squared = at_most(at_least(r2, R(0.0)), R(1.0));
  const reals t = TABLE_OVER_R2 ? squared : square_root(squared);
#if TABLE_TEXTURE
  return at_most(at_least(t * (real)table_size - R(0.5), R(0.0)), (reals)(real)(table_size - 1));
#else
  return t * (real)(table_size - 1);
#endif
}
#endif

// The Gaussian is exp(r^2 falloff) with falloff = -cutoff^2 / 2.
static inline reals weight_of(reals r2, real falloff, constant real *table, int table_size)
{
#if KERNEL == GAUSSIAN
  return exp_negative(r2 * falloff);
#elif KERNEL == CONSTANT
  return (reals)R(1.0);
#else
  const reals place = table_place(r2, table_size);
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
