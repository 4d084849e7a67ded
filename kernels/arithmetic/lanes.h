// Provides the arrangement of LANES values in a vector: a block of pixels, or numbers gathered from LANES places.

#include "arithmetic/reals.h"

// A block is LANES pixels, BLOCK_X across. EACH_LANE(item, field) lists item(lane, field) of every lane.
#if LANES == 1
#define BLOCK_X 1
#define LANE_X ((reals)R(0.0))
#define LANE_Y ((reals)R(0.0))
#define EACH_LANE(item, field) (item(0, field))
#elif LANES == 4
#define BLOCK_X 2
#define LANE_X ((reals)(0, 1, 0, 1))
#define LANE_Y ((reals)(0, 0, 1, 1))
#define EACH_LANE(item, field) (item(0, field), item(1, field), item(2, field), item(3, field))
#elif LANES == 8
#define BLOCK_X 4
#define LANE_X ((reals)(0, 1, 2, 3, 0, 1, 2, 3))
#define LANE_Y ((reals)(0, 0, 0, 0, 1, 1, 1, 1))
#define EACH_LANE(item, field)                                                                    \
  (item(0, field), item(1, field), item(2, field), item(3, field), item(4, field), item(5, field), \
   item(6, field), item(7, field))
#else
#define BLOCK_X 4
#define LANE_X ((reals)(0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3))
#define LANE_Y ((reals)(0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3))
#define EACH_LANE(item, field)                                                                         \
  (item(0, field), item(1, field), item(2, field), item(3, field), item(4, field), item(5, field),      \
   item(6, field), item(7, field), item(8, field), item(9, field), item(10, field), item(11, field),    \
   item(12, field), item(13, field), item(14, field), item(15, field))
#endif
#define BLOCK_Y (LANES / BLOCK_X)

#define LANE_OF(values, lane) (((const real *)&(values))[lane])
#define WHOLE_OF(values, lane) ((int)((const bits *)&(values))[lane])
