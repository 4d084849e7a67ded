// Margins: distances of decisions from flipping, in units of 2^-24 times a scale (splatcl/oracle). Needs arithmetic.h.

#include "arithmetic/reals.h"

#if !DOUBLE
#error "margins are computed in double precision: DOUBLE must be 1"
#endif

#define UNIT R(0x1p-24)
#define MAX_MARGIN R(128.0)  // as splatcl/uncertainty.py has it
#define TINY R(0x1p-1022)    // least scale, so that an exact tie has margin 0 even at z = 0
#define INFINITE ((reals)(real)INFINITY)

// PoCL calls functions that are only inline: a call stores every vector that is in use. (Oclgrind, of OpenCL 1.2, cannot
// run the intrinsics that always_inline leaves.)
#if __OPENCL_VERSION__ >= 200
#define INLINE static inline __attribute__((always_inline))
#else
#define INLINE static inline
#endif

INLINE reals square(reals x) { return x * x; }

// A NaN is never less and never more: what is not known does not decide.
static inline reals least_of(reals a, reals b) { return SELECT(a, b, MASK(b < a)); }
static inline reals most_of(reals a, reals b) { return SELECT(a, b, MASK(b > a)); }
