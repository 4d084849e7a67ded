// Layers of the tile lists. Needs clue.h.
//
// LAYER  EVERY entry; or first those in FRONT, and when these are drawn, those BEHIND that they do not hide

#define EVERY 0
#define FRONT 1
#define BEHIND 2

// The entries in [begin, end) that this layer projects; return how many.
static inline int entries_of_layer(global const int *clues, int begin, int end, int *entry)
{
  int num = 0;
  for (int i = begin; i < end; ++i) {
    entry[num] = i;
#if LAYER == EVERY
    ++num;
#elif LAYER == FRONT
    num += NEAR_BITS(clues[i]) == 0;
#else
    num += (NEAR_BITS(clues[i]) != 0) & (clues[i] != HIDDEN);
#endif
  }
  return num;
}
