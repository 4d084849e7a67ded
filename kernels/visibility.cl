// Visibility pass: depth(p) = min z over splats whose disc the pixel's ray hits, and which splat that was.
// A work-item takes one region of a tile and streams the tile's run; the pre-filter takes no part.

#include "arithmetic.h"
#include "splat.h"

#define NO_SPLAT 0xffffffffu

kernel void visibility(global const ProjectedSplat *records, global const int *tile_begin, const int first_tile,
                       const int tiles_x, const int width, const int height, const real near, const real far,
                       global real *depth, global uint *particleid)
{
  const region w = region_of(get_global_id(0), first_tile, tiles_x);
  const int begin = tile_begin[w.run], end = tile_begin[w.run + 1];
  reals z_min[BLOCKS];
  uints front[BLOCKS];
  for (int b = 0; b < BLOCKS; ++b) {
    z_min[b] = (reals)INFINITY;
    front[b] = (uints)NO_SPLAT;
  }
  for (int i = begin; i < end; ++i) {
    const ProjectedSplat s = records[i];
    const block_range r = blocks_of(&s, &w);
    for (int by = r.y_first; by <= r.y_last; ++by)
      for (int bx = r.x_first; bx <= r.x_last; ++bx) {
        const hit h = intersect(&s, w.x + bx * BLOCK_X, w.y + by * BLOCK_Y);
        if (!ANY(h.inside)) continue;
        const int b = by * BLOCKS_X + bx;
        const reals z = hit_depth(&s, &h, divide(R(1.0), h.den));
        const masks closer = h.inside & MASK(z < z_min[b]) & MASK(z >= near) & MASK(z <= far);
        z_min[b] = SELECT(z_min[b], z, closer);
        front[b] = (front[b] & ~UINT_MASK(closer)) | (s.id & UINT_MASK(closer));
      }
  }
  const real *z_lanes = (const real *)z_min;
  const uint *front_lanes = (const uint *)front;
  for (int i = 0; i < REGION * REGION; ++i) {
    const int block = i / LANES, lane = i % LANES;
    const int x = w.x + block % BLOCKS_X * BLOCK_X + lane % BLOCK_X;
    const int y = w.y + block / BLOCKS_X * BLOCK_Y + lane / BLOCK_X;
    if (x >= width || y >= height) continue;
    depth[(long)y * width + x] = z_lanes[i];
    particleid[(long)y * width + x] = front_lanes[i];
  }
}
