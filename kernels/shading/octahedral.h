// Provides the octahedral map of directions to a square, which needs no trigonometry.
//
// Directions go to the octahedron |x| + |y| + |z| = 1. Its half toward the eye (z < 0) keeps x and y, -1 ... 1, and
// lies in the middle of the square. The other half is folded out to the corners.
//
// LIGHTMAP  samples of the square each way: odd, so that its axes are sampled like its edges

#include "arithmetic/reals.h"
#include "arithmetic/divide.h"
#include "arithmetic/vectors.h"

#define HALF_MAP ((real)(LIGHTMAP >> 1))

static inline reals with_sign(reals size, reals of) { return SELECT(size, -size, MASK(of < R(0.0))); }

static inline void fold(reals *x, reals *y, masks far)
{
  const reals a = magnitude(*x), b = magnitude(*y);
  *x = SELECT(*x, with_sign(R(1.0) - b, *x), far);
  *y = SELECT(*y, with_sign(R(1.0) - a, *y), far);
}

// The unit direction of the sample (column, row).
static inline reals3 direction_of(reals column, reals row)
{
  reals x = divide(column, HALF_MAP) - R(1.0), y = divide(row, HALF_MAP) - R(1.0);
  const reals z = (magnitude(x) + magnitude(y)) - R(1.0);
  fold(&x, &y, MASK(z > R(0.0)));
  return normalize3((reals3){x, y, z});
}

// The place of a direction on the square, in samples. The vector may have any length except zero.
static inline void place_of(reals3 d, reals *column, reals *row)
{
  const reals size = (magnitude(d.x) + magnitude(d.y)) + magnitude(d.z);
  reals x = divide(d.x, size), y = divide(d.y, size);
  fold(&x, &y, MASK(d.z > R(0.0)));
  *column = (x + R(1.0)) * HALF_MAP;
  *row = (y + R(1.0)) * HALF_MAP;
}
