// The accounting: count the fragments splat by splat over each splat's own bounds, without tiles, runs or blocks. The
// host compares them with the counts of the attribute pass, which are pixel by pixel.

#include "arithmetic/reals.h"
#include "splat/disc.h"
#include "splat/extra.h"
#include "splat/fragment.h"

kernel void accounting(constant View *view, global const ProjectedSplat *records, global const ProjectedExtra *extra,
                       global const SplatAttributes *attributes, global const short4 *boxes, const int num_records,
                       const int chunk_size, const real epsilon, const int along_ray, const real inverse_radius2,
                       global const real *depth, global ulong *num_fragments)
{
  const int begin = get_global_id(0) * chunk_size, end = least(begin + chunk_size, num_records);
  ulong total = 0;
  for (int i = begin; i < end; ++i) {
    const ProjectedSplat s = records[i];
    const SplatAttributes a = attributes[i];
    const discs d = disc_of(&s);
    const prefilters p = prefilter_of(&s, &a);
    extras e;
    load_one_footprint(&e, extra, i);
    const short4 box = boxes[i];  // x_min, y_min, x_max, y_max
    for (int y = box.y; y <= box.w; ++y)
      for (int x = box.x; x <= box.z; ++x) {
        const hit h = intersect(&d, (reals)x, (reals)y);
        const real z = depth[(long)y * view->width + x];
        const fragment f = fragment_of(&d, &p, &e, &h, z, view->near, view->far, inverse_radius2);
        const reals farthest = farthest_accepted(view, (reals)x, (reals)y, z, epsilon, along_ray);
        if (f.exists & is_accepted(f.z, farthest)) ++total;
      }
  }
  num_fragments[get_global_id(0)] = total;
}
