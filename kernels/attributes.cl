// Attribute pass: every fragment no farther than depth(p) + epsilon adds weight * attribute, in splat order.
// A work-item takes one tile, streams its run again and keeps the tile's sums to itself.

#include "arithmetic.h"
#include "ray.h"
#include "splat.h"
#include "weight.h"

typedef struct {
  reals weight, red, green, blue, normal_x, normal_y, normal_z, z;
  uints count;
} sums;

typedef struct {
  reals r2, z;
  masks exists;
} fragment;

// r^2 = min(r3^2, r2^2); where only the pre-filter accepts, the depth is the centre's.
static inline fragment filter(const ProjectedSplat *s, const SplatAttributes *a, const hit *h, real near, real far,
                              real inverse_radius2)
{
  fragment f;
  const reals inverse_den = R(1.0) / h->den;
  f.z = hit_depth(s, h, inverse_den);
  f.exists = h->inside & MASK(f.z >= near) & MASK(f.z <= far);
  f.r2 = at_most(h->numerator * (inverse_den * inverse_den), R(1.0));
#if PREFILTER
  const reals x = h->dx - a->prefilter_x, y = h->dy - a->prefilter_y;
  const reals screen_r2 = (x * x + y * y) * inverse_radius2;
  f.r2 = SELECT(screen_r2, f.r2, f.exists & MASK(f.r2 < screen_r2));
  f.z = SELECT(s->z, f.z, f.exists);
  f.exists |= MASK(screen_r2 <= R(1.0));
#endif
  return f;
}

static inline void accumulate(sums *t, const SplatAttributes *a, const fragment *f, masks accepted, reals weight)
{
  weight = SELECT(R(0.0), weight, accepted);  // adding zero leaves a sum's bits as they are
  t->weight += weight;
  t->red += weight * a->red;
  t->green += weight * a->green;
  t->blue += weight * a->blue;
  t->normal_x += weight * a->normal_x;
  t->normal_y += weight * a->normal_y;
  t->normal_z += weight * a->normal_z;
  t->z += weight * SELECT(R(0.0), f->z, accepted);
  t->count -= UINT_MASK(accepted);
}

// depth(p) + epsilon; epsilon along a perspective ray is shorter along z.
static inline real farthest_accepted(constant View *view, int x, int y, real depth, real epsilon, int along_ray)
{
  if (ORTHOGRAPHIC || !along_ray) return depth + epsilon;
  const real dx = ray_x(view, x), dy = ray_y(view, y);
  return depth + epsilon / sqrt((dx * dx + dy * dy) + R(1.0));
}

kernel void attributes(constant View *view, global const ProjectedSplat *records,
                       global const SplatAttributes *splat_attributes, global const int *tile_begin,
                       const int first_tile, const int tiles_x, const real epsilon, const int along_ray,
                       const real falloff, const real inverse_radius2, constant real *table, const int table_size,
                       global const real *depth, global real *weight_sum, global real *color_sum,
                       global real *normal_sum, global real *depth_sum, global uint *count)
{
  const int tile = first_tile + get_global_id(0);
  const int tile_x = tile % tiles_x * TILE, tile_y = tile / tiles_x * TILE;
  const int begin = tile_begin[get_global_id(0)], end = tile_begin[get_global_id(0) + 1];
  const int width = view->width, height = view->height;
  const real near = view->near, far = view->far;
  sums tile_sums[BLOCKS];
  reals farthest[BLOCKS];
  for (int b = 0; b < BLOCKS; ++b) {
    tile_sums[b] = (sums){0};
    for (int lane = 0; lane < LANES; ++lane) {
      const int x = tile_x + b % BLOCKS_X * BLOCK_X + lane % BLOCK_X;
      const int y = tile_y + b / BLOCKS_X * BLOCK_Y + lane / BLOCK_X;
      ((real *)farthest)[b * LANES + lane] =
          x < width && y < height
              ? farthest_accepted(view, x, y, depth[(long)y * width + x], epsilon, along_ray)
              : R(0.0);
    }
  }
  for (int i = begin; i < end; ++i) {
    const ProjectedSplat s = records[i];
    const SplatAttributes a = splat_attributes[i];
    const block_range r = blocks_of(&s, tile_x, tile_y);
    for (int by = r.y_first; by <= r.y_last; ++by)
      for (int bx = r.x_first; bx <= r.x_last; ++bx) {
        const hit h = intersect(&s, tile_x + bx * BLOCK_X, tile_y + by * BLOCK_Y);
        const fragment f = filter(&s, &a, &h, near, far, inverse_radius2);
        const int b = by * BLOCKS_X + bx;
        const masks accepted = f.exists & MASK(f.z <= farthest[b]);
        if (!ANY(accepted)) continue;
        accumulate(&tile_sums[b], &a, &f, accepted, weight_of(f.r2, falloff, table, table_size));
      }
  }
  for (int b = 0; b < BLOCKS; ++b)
    for (int lane = 0; lane < LANES; ++lane) {
      const int x = tile_x + b % BLOCKS_X * BLOCK_X + lane % BLOCK_X;
      const int y = tile_y + b / BLOCKS_X * BLOCK_Y + lane / BLOCK_X;
      if (x >= width || y >= height) continue;
      const long p = (long)y * width + x;
      const real *t = (const real *)&tile_sums[b] + lane;
      weight_sum[p] = t[0];
      color_sum[3 * p] = t[LANES];
      color_sum[3 * p + 1] = t[2 * LANES];
      color_sum[3 * p + 2] = t[3 * LANES];
      normal_sum[3 * p] = t[4 * LANES];
      normal_sum[3 * p + 1] = t[5 * LANES];
      normal_sum[3 * p + 2] = t[6 * LANES];
      depth_sum[p] = t[7 * LANES];
      count[p] = ((const uint *)&tile_sums[b].count)[lane];
    }
}
