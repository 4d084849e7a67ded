// Provides the unit of margins, the distances of decisions from flipping: 2^-24 times the scale of the rounding error.

#include "arithmetic/reals.h"

#if !DOUBLE
#error "margins are computed in double precision: DOUBLE must be 1"
#endif

#define UNIT R(0x1p-24)
#define MAX_MARGIN R(128.0)  // MAX_MARGIN of the host
#define TINY R(0x1p-1022)    // least scale: an exact tie has margin 0 even at z = 0
#define INFINITE ((reals)(real)INFINITY)

// PoCL calls functions that are only inline, and a call stores every vector in use. (Oclgrind, of OpenCL 1.2, cannot
// run the intrinsics that always_inline leaves.)
#if __OPENCL_VERSION__ >= 200
#define INLINE static inline __attribute__((always_inline))
#else
#define INLINE static inline
#endif

INLINE reals square(reals x) { return x * x; }

// A NaN is neither less nor more than a number, so an unknown value decides nothing.
static inline reals least_of(reals a, reals b) { return SELECT(a, b, MASK(b < a)); }
static inline reals most_of(reals a, reals b) { return SELECT(a, b, MASK(b > a)); }
