// Upload of splats: write one array of vectors where the passes read it. A work-item takes one splat.

#include "arithmetic/reals.h"

// Write `values`, (num_splats, 3), to the three reals from `first` of every Splat. If `to_planes`, also write them to
// planes of x, y and z; each plane has `stride` reals, and those after the last splat become 0.
kernel void upload(global const real *values, const int num_splats, const int stride, const int first,
                   const int to_planes, global real *planes, global Splat *splats)
{
  const int i = get_global_id(0);
  for (int axis = 0; axis < 3; ++axis) {
    const real value = i < num_splats ? values[3L * i + axis] : R(0.0);
    if (i < num_splats) ((global real *)(splats + i))[first + axis] = value;
    if (to_planes) planes[(long)axis * stride + i] = value;
  }
}
