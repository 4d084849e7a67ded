// Provides the occlusion key of an entry of the tile lists, and the layers in which the entries are projected.
//
// A key holds a lower bound of the fragments' depths, the upper 24 bits of a positive float, or 0 in the tile's front
// layer. It also holds the quarters of the tile's sides that the splat may touch: first and last column, first and last
// row, two bits each. Positive floats have the order of their bits.
//
// TILE   side of a tile, pixels
// LAYER  EVERY entry; or first those in the FRONT layer, then those BEHIND it that the front layer does not occlude

#define NEAR_BITS(word) ((word) & 0x7fffff00)
#define BEYOND_ALL 0x7fffffff  // above the bits of every depth; an unknown depth is 0
#define OCCLUDED 0x7fffffff    // the whole key: no part of the splat is visible in the tile
#define QUARTER_SHIFT (TILE == 8 ? 1 : TILE == 16 ? 2 : TILE == 32 ? 3 : 4)  // log2 of a quarter of a side in pixels

#define EVERY 0
#define FRONT 1
#define BEHIND 2

// Give the entries in [begin, end) that this layer projects; return their number.
static inline int entries_of_layer(global const int *occlusion_keys, int begin, int end, int *entry)
{
  int num = 0;
  for (int i = begin; i < end; ++i) {
    entry[num] = i;
#if LAYER == EVERY
    ++num;
#elif LAYER == FRONT
    num += NEAR_BITS(occlusion_keys[i]) == 0;
#else
    num += (NEAR_BITS(occlusion_keys[i]) != 0) & (occlusion_keys[i] != OCCLUDED);
#endif
  }
  return num;
}
