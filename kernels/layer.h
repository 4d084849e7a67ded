// Layers of the tile lists: those entries of each tile that are near its nearest, and those behind that they do not hide.
// Needs arithmetic.h and the build options TILE and LAYER.

#include "clue.h"

#define EVERY 0
#define FRONT 1
#define BEHIND 2

// The farthest depth that is accepted in each of a tile's four by four parts, and bits that are farther than any.
typedef struct {
  real part[16];
  int beyond;
} hiding;

// For the tile whose first pixel is (left, top), as `depth` is so far.
static inline hiding hiding_of(global const real *depth, int left, int top, int width, int height, real epsilon)
{
  hiding h;
  real whole = -(real)INFINITY;
  for (int row = 0; row < 4; ++row) {
    real column[TILE];
    for (int x = 0; x < TILE; ++x) column[x] = -(real)INFINITY;
    const int first = top + (row << QUARTER_SHIFT), across = least(TILE, width - left);
    for (int y = first; y < least(first + TILE / 4, height); ++y)
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
  h.beyond = whole < (real)FLT_MAX ? as_int((float)whole) + 1 : UNKNOWN;
  return h;
}

// Whether a splat may show: its fragments are no nearer than near_z, and are not accepted beyond what is farthest.
static inline int may_show(int clue, const hiding *h)
{
  const real near_z = (real)as_float(NEAR_BITS(clue));
  int shows = 0;
  for (int y = clue >> 4 & 3; y <= (clue >> 6 & 3); ++y)
    for (int x = clue & 3; x <= (clue >> 2 & 3); ++x) shows |= near_z <= h->part[4 * y + x];
  return shows;
}

// The tile lists of a band, and by what an entry is chosen for a layer.
typedef struct {
  global const int *clues, *begin, *layer_ends;
  int num_tiles, first_tile, tiles_x;
  global const real *depth;
  real epsilon;
} tile_lists;

// The tile whose list holds the entry i.
static inline int tile_of(const tile_lists *l, int i)
{
  int low = 0, high = l->num_tiles;
  while (high - low > 1) {
    const int middle = (low + high) / 2;
    low = l->begin[middle] <= i ? middle : low;
    high = l->begin[middle] <= i ? high : middle;
  }
  return low;
}

// Append the entries in [begin, end) whose nearest depth is in (after, upto].
static inline int append_between(global const int *clues, int begin, int end, int after, int upto, int *entry, int num)
{
  for (int i = begin; i < end; ++i) {
    const int z = NEAR_BITS(clues[i]);
    entry[num] = i;
    num += (z > after) & (z <= upto);
  }
  return num;
}

// The entries in [begin, end) that this layer is to project; return how many.
static inline int entries_of_layer(constant View *view, const tile_lists *l, int begin, int end, int *entry)
{
  int num = 0;
#if LAYER == EVERY
  for (int i = begin; i < end; ++i) entry[num++] = i;
#else
  int tile = tile_of(l, begin);
  for (int i = begin; i < end; ++tile) {
    const int stop = least(end, l->begin[tile + 1]), layer_end = l->layer_ends[l->first_tile + tile];
#if LAYER == FRONT
    num = append_between(l->clues, i, stop, -1, layer_end, entry, num);
#else
    const int left = (l->first_tile + tile) % l->tiles_x * TILE, top = (l->first_tile + tile) / l->tiles_x * TILE;
    const hiding h = hiding_of(l->depth, left, top, view->width, view->height, l->epsilon);
    const int candidates = append_between(l->clues, i, stop, layer_end, h.beyond, entry, num);
    for (int k = num; k < candidates; ++k) {
      entry[num] = entry[k];
      num += may_show(l->clues[entry[k]], &h);
    }
#endif
    i = stop;
  }
#endif
  return num;
}
