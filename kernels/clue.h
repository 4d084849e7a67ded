// What an entry of the tile lists says of its splat before it is projected: a depth that no fragment is nearer than, a
// positive float's upper 24 bits; and which quarters of the tile's sides it may touch: first and last column, first and
// last row, two bits each. Positive floats are in the order of their bits. Needs arithmetic.h.

#define NEAR_BITS(word) ((word) & 0x7fffff00)
#define UNKNOWN 0x7fffffff  // farther than all; a near_z that is not known is 0
#define QUARTER_SHIFT (TILE == 8 ? 1 : TILE == 16 ? 2 : TILE == 32 ? 3 : 4)  // a quarter of a side, pixels
