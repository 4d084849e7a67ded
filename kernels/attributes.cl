// Attribute pass: every fragment no farther than depth(p) + epsilon adds weight * attribute, in splat order.
// A work-item takes one region of a tile, streams the tile's run again and keeps the region's sums to itself.

#include "arithmetic.h"
#include "ray.h"
#include "splat.h"
#include "fragment.h"
#include "weight.h"

#define LANE(values) (((const real *)&(values))[lane])

kernel void attributes(constant View *view, global const ProjectedSplat *records,
                       global const SplatAttributes *splat_attributes, global const int *tile_begin,
                       const int first_tile, const int tiles_x, const real epsilon, const int along_ray,
                       const real falloff, const real inverse_radius2, constant real *table, const int table_size,
                       global const real *depth, global real *weight_sum, global real *color_sum,
                       global real *normal_sum, global real *depth_sum, global uint *count)
{
  const region w = region_of(get_global_id(0), first_tile, tiles_x);
  const int begin = tile_begin[w.run], end = tile_begin[w.run + 1];
  const int width = view->width, height = view->height;
  const real near = view->near, far = view->far;
  sums region_sums[BLOCKS];
  reals farthest[BLOCKS];
  for (int b = 0; b < BLOCKS; ++b) {
    region_sums[b] = (sums){0};
    for (int lane = 0; lane < LANES; ++lane) {
      const int x = w.x + b % BLOCKS_X * BLOCK_X + lane % BLOCK_X;
      const int y = w.y + b / BLOCKS_X * BLOCK_Y + lane / BLOCK_X;
      ((real *)farthest)[b * LANES + lane] =
          x < width && y < height
              ? farthest_accepted(view, x, y, depth[(long)y * width + x], epsilon, along_ray)
              : R(0.0);
    }
  }
  for (int i = begin; i < end; ++i) {
    const ProjectedSplat s = records[i];
    const SplatAttributes a = splat_attributes[i];
    const block_range r = blocks_of(&s, &w);
    for (int by = r.y_first; by <= r.y_last; ++by)
      for (int bx = r.x_first; bx <= r.x_last; ++bx) {
        const hit h = intersect(&s, w.x + bx * BLOCK_X, w.y + by * BLOCK_Y);
        const fragment f = filter(&s, &a, &h, near, far, inverse_radius2);
        const int b = by * BLOCKS_X + bx;
        const masks accepted = f.exists & MASK(f.z <= farthest[b]);
        if (!ANY(accepted)) continue;
        accumulate(&region_sums[b], &a, &f, accepted, weight_of(f.r2, falloff, table, table_size));
      }
  }
  for (int b = 0; b < BLOCKS; ++b)
    for (int lane = 0; lane < LANES; ++lane) {
      const int x = w.x + b % BLOCKS_X * BLOCK_X + lane % BLOCK_X;
      const int y = w.y + b / BLOCKS_X * BLOCK_Y + lane / BLOCK_X;
      if (x >= width || y >= height) continue;
      const long p = (long)y * width + x;
      const sums *t = &region_sums[b];
      weight_sum[p] = LANE(t->weight);
      color_sum[3 * p] = LANE(t->red);
      color_sum[3 * p + 1] = LANE(t->green);
      color_sum[3 * p + 2] = LANE(t->blue);
      normal_sum[3 * p] = LANE(t->normal_x);
      normal_sum[3 * p + 1] = LANE(t->normal_y);
      normal_sum[3 * p + 2] = LANE(t->normal_z);
      depth_sum[p] = LANE(t->z);
      count[p] = ((const uint *)&t->count)[lane];
    }
}
