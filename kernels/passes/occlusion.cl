// Occlusion culling: mark the splats behind a tile's front layer that this layer occludes. It runs after the visibility
// pass of the front layer. A work-item takes one tile.

#include "arithmetic/reals.h"
#include "passes/occlusion.h"

// The greatest accepted depth in each of a tile's four by four parts, and the bits of the greatest of all.
typedef struct {
  real part[16];
  int farthest;
} occluders;

// The occluders in the tile with first pixel (left, top), by the depth so far.
static inline occluders occluders_of(global const real *depth, int left, int top, int width, int height, real epsilon)
{
  occluders h;
  real whole = -(real)INFINITY;
  for (int row = 0; row < 4; ++row) {
    real column[TILE];
    for (int x = 0; x < TILE; ++x) column[x] = -(real)INFINITY;
    const int first = top + (row << QUARTER_SHIFT), across = least(TILE, width - left);
    for (int y = first; y < least(first + (1 << QUARTER_SHIFT), height); ++y)
      for (int x = 0; x < across; ++x) {
        const real z = depth[(long)y * width + left + x];
        column[x] = z > column[x] ? z : column[x];
      }
    for (int k = 0; k < 4; ++k) {
      real z = -(real)INFINITY;
      for (int x = k << QUARTER_SHIFT; x < (k + 1) << QUARTER_SHIFT; ++x) z = column[x] > z ? column[x] : z;
      h.part[4 * row + k] = z + epsilon;
      whole = z + epsilon > whole ? z + epsilon : whole;
    }
  }
  h.farthest = as_int((float)whole);
  return h;
}

// Whether a splat may be visible: its fragments have depths >= near_z, and are accepted up to the parts' depths.
static inline int may_be_visible(int key, const occluders *h)
{
  const real near_z = (real)as_float(NEAR_BITS(key));
  int shows = 0;
  for (int y = key >> 4 & 3; y <= (key >> 6 & 3); ++y)
    for (int x = key & 3; x <= (key >> 2 & 3); ++x) shows |= near_z <= h->part[4 * y + x];
  return shows;
}

kernel void occlusion(global int *occlusion_keys, const int first, global const int *tile_begin, const int first_tile,
                      const int tiles_x, const int width, const int height, const real epsilon,
                      global const real *depth)
{
  const int run = get_global_id(0), tile = first_tile + run;
  const int begin = first + tile_begin[run], end = first + tile_begin[run + 1];
  if (begin >= end) return;
  const occluders h = occluders_of(depth, tile % tiles_x * TILE, tile / tiles_x * TILE, width, height, epsilon);
  for (int i = begin; i < end; ++i) {
    const int key = occlusion_keys[i];
    if (NEAR_BITS(key) && (NEAR_BITS(key) > h.farthest || !may_be_visible(key, &h))) occlusion_keys[i] = OCCLUDED;
  }
}
