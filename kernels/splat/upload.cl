// Upload of splats: write one array of vectors where the passes read it. A work-item takes one splat and one axis.

#include "arithmetic/reals.h"

// Write `values`, (num_splats, 3), to the three reals from `first` of every Splat, which has `num_fields` reals.
kernel void upload_records(global const real *values, const int num_fields, const int first, global real *splats)
{
  const int i = get_global_id(0), axis = get_global_id(1);
  splats[(long)num_fields * i + first + axis] = values[3L * i + axis];
}

// Write `values` to planes of x, y and z with `stride` reals each. The reals after the last splat become 0.
kernel void upload_planes(global const real *values, const int num_splats, const int stride, global real *planes)
{
  const int i = get_global_id(0), axis = get_global_id(1);
  planes[(long)axis * stride + i] = i < num_splats ? values[3L * i + axis] : R(0.0);
}
