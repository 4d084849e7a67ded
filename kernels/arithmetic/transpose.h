// Provides LOAD_EIGHT and STORE_EIGHT, which move LANES records of eight reals to and from eight vectors.
//
// On PoCL, in single precision with eight lanes, this is a transposition of registers: twice as fast as lane by lane.
// (Unoptimized, the transposition makes Oclgrind crash.)

#include "arithmetic/reals.h"

typedef struct {
  real8 values;
} __attribute__((packed, aligned(DOUBLE ? 8 : 4))) unaligned8;  // a vload8 without PoCL 3.0's call

typedef struct {
  reals v[8];
} eight;

#if ON_POCL && LANES == 8 && !DOUBLE
#define LOW_PAIRS(a, b) ((float8)((a).s0, (b).s0, (a).s1, (b).s1, (a).s4, (b).s4, (a).s5, (b).s5))
#define HIGH_PAIRS(a, b) ((float8)((a).s2, (b).s2, (a).s3, (b).s3, (a).s6, (b).s6, (a).s7, (b).s7))
#define LOW_QUADS(a, b) ((float8)((a).s0, (a).s1, (b).s0, (b).s1, (a).s4, (a).s5, (b).s4, (b).s5))
#define HIGH_QUADS(a, b) ((float8)((a).s2, (a).s3, (b).s2, (b).s3, (a).s6, (a).s7, (b).s6, (b).s7))

static inline void transpose(reals *v)
{
  const float8 p0 = LOW_PAIRS(v[0], v[1]), p1 = HIGH_PAIRS(v[0], v[1]);
  const float8 p2 = LOW_PAIRS(v[2], v[3]), p3 = HIGH_PAIRS(v[2], v[3]);
  const float8 p4 = LOW_PAIRS(v[4], v[5]), p5 = HIGH_PAIRS(v[4], v[5]);
  const float8 p6 = LOW_PAIRS(v[6], v[7]), p7 = HIGH_PAIRS(v[6], v[7]);
  const float8 q0 = LOW_QUADS(p0, p2), q1 = HIGH_QUADS(p0, p2), q2 = LOW_QUADS(p1, p3), q3 = HIGH_QUADS(p1, p3);
  const float8 q4 = LOW_QUADS(p4, p6), q5 = HIGH_QUADS(p4, p6), q6 = LOW_QUADS(p5, p7), q7 = HIGH_QUADS(p5, p7);
  v[0] = (float8)(q0.lo, q4.lo);
  v[1] = (float8)(q1.lo, q5.lo);
  v[2] = (float8)(q2.lo, q6.lo);
  v[3] = (float8)(q3.lo, q7.lo);
  v[4] = (float8)(q0.hi, q4.hi);
  v[5] = (float8)(q1.hi, q5.hi);
  v[6] = (float8)(q2.hi, q6.hi);
  v[7] = (float8)(q3.hi, q7.hi);
}
#define LOAD_EIGHT(fields, space, place) /* place: of lane's first real */                                     \
  eight fields;                                                                                                \
  for (int lane = 0; lane < LANES; ++lane) fields.v[lane] = ((space const unaligned8 *)(place))->values;       \
  transpose(fields.v)
#define STORE_EIGHT(fields, num, place)                                                                        \
  transpose(fields.v);                                                                                         \
  for (int lane = 0; lane < (num); ++lane) ((global unaligned8 *)(place))->values = fields.v[lane]
#else  // row by row, each as one vector: rusticl would step through a record's words by whole records
#define LOAD_EIGHT(fields, space, place)                                                                       \
  eight fields;                                                                                                \
  for (int lane = 0; lane < LANES; ++lane) {                                                                   \
    const real8 row = ((space const unaligned8 *)(place))->values;                                             \
    LANE_OF_EIGHT(fields, 0) = row.s0, LANE_OF_EIGHT(fields, 1) = row.s1, LANE_OF_EIGHT(fields, 2) = row.s2;   \
    LANE_OF_EIGHT(fields, 3) = row.s3, LANE_OF_EIGHT(fields, 4) = row.s4, LANE_OF_EIGHT(fields, 5) = row.s5;   \
    LANE_OF_EIGHT(fields, 6) = row.s6, LANE_OF_EIGHT(fields, 7) = row.s7;                                      \
  }
#define STORE_EIGHT(fields, num, place)                                                                        \
  for (int lane = 0; lane < (num); ++lane)                                                                     \
  ((global unaligned8 *)(place))->values =                                                                     \
      (real8)(LANE_OF_EIGHT(fields, 0), LANE_OF_EIGHT(fields, 1), LANE_OF_EIGHT(fields, 2),                    \
              LANE_OF_EIGHT(fields, 3), LANE_OF_EIGHT(fields, 4), LANE_OF_EIGHT(fields, 5),                    \
              LANE_OF_EIGHT(fields, 6), LANE_OF_EIGHT(fields, 7))
#define LANE_OF_EIGHT(fields, word) (((real *)&fields.v[word])[lane])
#endif
