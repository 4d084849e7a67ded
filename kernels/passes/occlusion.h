// What an entry of the tile lists says of its splat before it is projected: 0 in the tile's front layer, otherwise a depth
// that no fragment is nearer than, a positive float's upper 24 bits; and which quarters of the tile's sides it may touch:
// first and last column, first and last row, two bits each. Positive floats are in the order of their bits.

#define NEAR_BITS(word) ((word) & 0x7fffff00)
#define BEYOND_ALL 0x7fffffff  // bits of no depth, and beyond those of all; a depth that is not known is 0
#define OCCLUDED 0x7fffffff      // the whole clue: nothing of the splat shows in the tile
#define QUARTER_SHIFT (TILE == 8 ? 1 : TILE == 16 ? 2 : TILE == 32 ? 3 : 4)  // a quarter of a side, pixels

// Layers of the tile lists. Needs clue.h.
//
// LAYER  EVERY entry; or first those in FRONT, and when these are drawn, those BEHIND that they do not hide

#define EVERY 0
#define FRONT 1
#define BEHIND 2

// The entries in [begin, end) that this layer projects; return how many.
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
