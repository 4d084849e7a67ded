// Directions on a square, without trigonometry: the octahedron |x| + |y| + |z| = 1, its half toward the eye (z < 0) in
// the middle, the other folded out to the corners; x and y, -1 ... 1, stay as they are in the middle. Needs surface.h.
//
// LIGHTMAP  samples of the square each way, odd, its edges and axes among them

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

// Unit, of the sample (column, row).
static inline reals3 direction_of(reals column, reals row)
{
  reals x = divide(column, HALF_MAP) - R(1.0), y = divide(row, HALF_MAP) - R(1.0);
  const reals z = (magnitude(x) + magnitude(y)) - R(1.0);
  fold(&x, &y, MASK(z > R(0.0)));
  return normalize3((reals3){x, y, z});
}

// Where a direction is on the square, in samples; it need not be a unit vector, but not zero.
static inline void place_of(reals3 d, reals *column, reals *row)
{
  const reals size = (magnitude(d.x) + magnitude(d.y)) + magnitude(d.z);
  reals x = divide(d.x, size), y = divide(d.y, size);
  fold(&x, &y, MASK(d.z > R(0.0)));
  *column = (x + R(1.0)) * HALF_MAP;
  *row = (y + R(1.0)) * HALF_MAP;
}
