// The roofline: the peak bandwidth and arithmetic of this device, measured with the kernels' own vectors.
//
// Work-item i takes the vectors i * first + k * step, k < count, of LANES reals: runs of a buffer on a CPU, adjacent
// vectors on a GPU. The kernels write their sums, so the compiler cannot drop any work.
//
// STREAMS, CHAINS  independent sums of a work-item, in roofline_read and roofline_arithmetic

#include "arithmetic/reals.h"

#if !defined STREAMS || !defined CHAINS
#error "build options STREAMS and CHAINS are missing: the independent sums of a work-item"
#endif
#define UNROLLED 8  // steps of every chain per test of the loop's end

#if LANES == 1
#define LOAD(numbers, place) ((numbers)[place])
#define STORE(value, numbers, place) ((numbers)[place] = (value))
#else
#define LOAD(numbers, place) PASTE(vload, LANES)(place, numbers)
#define STORE(value, numbers, place) PASTE(vstore, LANES)(value, place, numbers)
#endif

kernel void roofline_read(global const real *numbers, global real *sums, const int first, const int step,
                          const int count)
{
  const long begin = (long)get_global_id(0) * first;
  reals sum[STREAMS];
  for (int s = 0; s < STREAMS; ++s) sum[s] = (reals)R(0.0);
  for (int k = 0; k < count; k += STREAMS)
    for (int s = 0; s < STREAMS; ++s) sum[s] += LOAD(numbers, begin + (long)(k + s) * step);
  STORE((sum[0] + sum[1]) + (sum[2] + sum[3]), sums, get_global_id(0));
}

kernel void roofline_write(global real *numbers, const int first, const int step, const int count)
{
  const long begin = (long)get_global_id(0) * first;
  const reals value = (reals)(real)get_global_id(0);
  for (int k = 0; k < count; ++k) STORE(value, numbers, begin + (long)k * step);
}

kernel void roofline_copy(global const real *numbers, global real *copy, const int first, const int step,
                          const int count)
{
  const long begin = (long)get_global_id(0) * first;
  for (int k = 0; k < count; ++k) {
    const long place = begin + (long)k * step;
    const reals value = LOAD(numbers, place);
    STORE(value, copy, place);
  }
}

kernel void roofline_arithmetic(global real *sums, const real factor, const real term, const int count)
{
  reals a[CHAINS];
  for (int c = 0; c < CHAINS; ++c) a[c] = (reals)(real)(c + 1);
  for (int k = 0; k < count; k += UNROLLED)
    for (int u = 0; u < UNROLLED; ++u)
      for (int c = 0; c < CHAINS; ++c) a[c] = a[c] * factor + term;
  reals sum = (reals)R(0.0);
  for (int c = 0; c < CHAINS; ++c) sum += a[c];
  STORE(sum, sums, get_global_id(0));
}
