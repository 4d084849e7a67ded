// One splat under one block of pixels: written once, used by the visibility and the attribute pass, so that
// both decide coverage and depth with the same bits. Needs arithmetic.h and the build options
// TILE, REGION, ORTHOGRAPHIC, PREFILTER.

// A block is LANES pixels. A work-item takes a region of REGION x REGION pixels, BLOCKS_X x BLOCKS_Y blocks: a
// whole tile of TILE x TILE, which suits a CPU, or one pixel of it (REGION 1, LANES 1), which suits a GPU.
#if LANES == 1
#define BLOCK_X 1
#define BLOCK_Y 1
#define LANE_X ((reals)R(0.0))
#define LANE_Y ((reals)R(0.0))
#elif LANES == 4
#define BLOCK_X 2
#define BLOCK_Y 2
#define LANE_X ((reals)(0, 1, 0, 1))
#define LANE_Y ((reals)(0, 0, 1, 1))
#elif LANES == 8
#define BLOCK_X 4
#define BLOCK_Y 2
#define LANE_X ((reals)(0, 1, 2, 3, 0, 1, 2, 3))
#define LANE_Y ((reals)(0, 0, 0, 0, 1, 1, 1, 1))
#else
#define BLOCK_X 4
#define BLOCK_Y 4
#define LANE_X ((reals)(0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3))
#define LANE_Y ((reals)(0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3))
#endif
#define BLOCKS_X (REGION / BLOCK_X)
#define BLOCKS_Y (REGION / BLOCK_Y)
#define BLOCKS (BLOCKS_X * BLOCKS_Y)
#define REGIONS_X (TILE / REGION)  // of one tile
#define REGIONS (REGIONS_X * REGIONS_X)

// The region of a work-item: its tile's run of records, and its first pixel.
typedef struct {
  int run, x, y;
} region;

static inline region region_of(int item, int first_tile, int tiles_x)
{
  const int tile = first_tile + item / REGIONS, part = item % REGIONS;
  region w = {item / REGIONS, tile % tiles_x * TILE + part % REGIONS_X * REGION,
              tile / tiles_x * TILE + part / REGIONS_X * REGION};
  return w;
}

// The blocks of a region that a record's bounds touch, ends included.
typedef struct {
  int x_first, x_last, y_first, y_last;
} block_range;

static inline block_range blocks_of(const ProjectedSplat *s, const region *w)
{
  block_range r = {max(s->x_min - w->x, 0) / BLOCK_X, min(s->x_max - w->x, REGION - 1) / BLOCK_X,
                   max(s->y_min - w->y, 0) / BLOCK_Y, min(s->y_max - w->y, REGION - 1) / BLOCK_Y};
  return r;
}

typedef struct {
  reals dx, dy;           // pixel centre from the reference point, pixels
  reals u, v, numerator;  // disc coordinates times den; u^2 + v^2
  reals den;              // 1 + g.(dx, dy); 1 when orthographic
  masks inside;           // u^2 + v^2 <= 1 and in front of the eye; near and far are not yet tested
} hit;

// Block origins are whole numbers, so the subtraction of pixel_x is exact and dx is rounded once.
static inline hit intersect(const ProjectedSplat *s, int x, int y)
{
  hit h;
  h.dx = (LANE_X + ((real)x - s->pixel_x)) - s->offset_x;
  h.dy = (LANE_Y + ((real)y - s->pixel_y)) - s->offset_y;
  h.u = (s->u_x * h.dx + s->u_y * h.dy) + s->u_1;
  h.v = (s->v_x * h.dx + s->v_y * h.dy) + s->v_1;
#if ORTHOGRAPHIC
  h.den = (reals)R(1.0);
  h.numerator = h.u * h.u + h.v * h.v;
  h.inside = MASK(h.numerator <= R(1.0));
#else
  h.den = (s->g_x * h.dx + s->g_y * h.dy) + R(1.0);
  h.numerator = h.u * h.u + h.v * h.v;
  h.inside = MASK(h.numerator <= h.den * h.den) & MASK(h.den > R(0.0));
#endif
  return h;
}

// Eye-space z of the disc along the pixel's ray.
static inline reals hit_depth(const ProjectedSplat *s, const hit *h, reals inverse_den)
{
#if ORTHOGRAPHIC
  return (s->g_x * h->dx + s->g_y * h->dy) + s->z;
#else
  return inverse_den * s->z;
#endif
}
