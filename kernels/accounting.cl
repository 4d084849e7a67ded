// Accounting: the fragments of each projected splat, counted splat by splat over its own bounds, without tiles, runs
// or blocks, for comparison with the counts that the attribute pass takes pixel by pixel.

#include "arithmetic.h"
#include "ray.h"
#include "splat.h"
#include "fragment.h"

kernel void accounting(constant View *view, global const ProjectedSplat *records,
                       global const SplatAttributes *attributes, global const int *num_survivors,
                       const int chunk_size, const real epsilon, const int along_ray, const real inverse_radius2,
                       global const real *depth, global ulong *num_fragments)
{
  const int chunk = get_global_id(0);
  const int begin = chunk * chunk_size, end = begin + num_survivors[chunk];
  ulong total = 0;
  for (int i = begin; i < end; ++i) {
    const ProjectedSplat s = records[i];
    const SplatAttributes a = attributes[i];
    for (int y = s.y_min; y <= s.y_max; ++y)
      for (int x = s.x_min; x <= s.x_max; ++x) {
        const hit h = intersect(&s, x, y);
        const fragment f = filter(&s, &a, &h, view->near, view->far, inverse_radius2);
        const real z = depth[(long)y * view->width + x];
        if (f.exists && f.z <= farthest_accepted(view, x, y, z, epsilon, along_ray)) ++total;
      }
  }
  num_fragments[chunk] = total;
}
