// Provides the extremes of weighted means of a block's fragments, each weight anywhere between its bounds.

#include "arithmetic/reals.h"
#include "arithmetic/divide.h"
#include "evidence/margin.h"
#include "evidence/pair.h"

#define MEANS 6  // of color and normal
#define NORMAL 3
#define MAX_STEPS 64  // afterwards, the bound of a mean is that of its values

// The settings of the frame.
typedef struct {
  constant View *view;
  constant real *table;  // of weights
  real tolerance, unit;  // in units of each decision's rounding error; times 2^-24
  real offset_error, epsilon, falloff;
  int along_ray, table_size;
} envelope_settings;

// The data of a work-item: its records and its part of the scratch buffers. These hold the list of the records at a
// block, and the least and greatest weight and value of each possible fragment.
typedef struct {
  global const NearbySplat *records;
  global const short4 *bounds;
  global const real *values;
  global int *list;
  global reals *weights;
  global real *extremes;
} scratch;

// Sums over a block's fragments.
typedef struct {
  reals low, high, count;  // of the sure weights, of the possible ones, and their number
  reals front_weight;      // least weight of the possible front-most fragments
  int num;                 // fragments
} weight_sums;

// The least and greatest of sum(w v) / sum(w) over all weights within their bounds, by Dinkelbach's iteration. From a
// mean m, the greatest weights where v > m and the least elsewhere lead to a greater mean.
INLINE void bound_mean(const scratch *t, const weight_sums *c, int k, reals *low, reals *high)
{
  reals least = INFINITE, most = -INFINITE, last_least, last_most, largest = (reals)R(0.0);
  masks moves = 0;
  for (int step = 0; step < MAX_STEPS; ++step) {
    reals total_low = (reals)R(0.0), sum_low = total_low, total_high = total_low, sum_high = total_low;
    for (int i = 0; i < c->num; ++i) {
      const real v_low = t->extremes[2 * (MEANS * i + k)], v_high = t->extremes[2 * (MEANS * i + k) + 1];
      const reals w_least = t->weights[2 * i], w_most = t->weights[2 * i + 1];
      if (step == 0) largest = SELECT(largest, most_of(largest, (reals)magnitude_of(v_high)), MASK(w_most > R(0.0)));
      const reals w_low = SELECT(w_least, w_most, MASK(v_low < least));
      const reals w_high = SELECT(w_least, w_most, MASK(v_high > most));
      total_low += w_low;
      sum_low += w_low * v_low;
      total_high += w_high;
      sum_high += w_high * v_high;
    }
    last_least = least;
    last_most = most;
    least = SELECT(least, least_of(least, divide(sum_low, total_low)), MASK(total_low > R(0.0)));
    most = SELECT(most, most_of(most, divide(sum_high, total_high)), MASK(total_high > R(0.0)));
    moves = MASK(least != last_least) | MASK(most != last_most);
    if (!ANY(moves)) break;
  }
  const reals rounding = R(4.0) * UNIT * (c->count + R(4.0)) * largest;
  const masks none = MASK(most == -INFINITE);
  least = SELECT(least, -largest, MASK(least != last_least)) - rounding;
  most = SELECT(most, largest, MASK(most != last_most)) + rounding;
  *low = SELECT(least, (reals)R(0.0), none);
  *high = SELECT(most, (reals)R(0.0), none);
}

// A bound of one coordinate of v / |v|, v in a box; `far` and `near` bound the sum of the other coordinates' squares.
INLINE reals normalized(reals v, reals far, reals near, masks inward)
{
  return divide(v, square_root(square(v) + SELECT(near, far, inward)));
}

INLINE void normalize_box(reals *low, reals *high)
{
  reals far[3], near[3];
  masks holds_zero = (masks)-1, nothing = (masks)-1;
  for (int k = 0; k < 3; ++k) {
    const reals a = square(low[k]), b = square(high[k]);
    far[k] = most_of(a, b);
    near[k] = SELECT(least_of(a, b), (reals)R(0.0), MASK(low[k] <= R(0.0)) & MASK(high[k] >= R(0.0)));
    holds_zero &= MASK(near[k] == R(0.0));
    nothing &= MASK(far[k] == R(0.0));
  }
  const reals all_far = (far[0] + far[1]) + far[2], all_near = (near[0] + near[1]) + near[2];
  for (int k = 0; k < 3; ++k) {
    const reals others_far = all_far - far[k], others_near = all_near - near[k];
    const reals least = normalized(low[k], others_far, others_near, MASK(low[k] >= R(0.0))) - R(8.0) * UNIT;
    const reals most = normalized(high[k], others_far, others_near, MASK(high[k] < R(0.0))) + R(8.0) * UNIT;
    low[k] = SELECT(SELECT(least, (reals)R(-1.0), holds_zero), (reals)R(0.0), nothing);
    high[k] = SELECT(SELECT(most, (reals)R(1.0), holds_zero), (reals)R(0.0), nothing);
  }
}
