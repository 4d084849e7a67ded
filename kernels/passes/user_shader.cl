// A user's shader: shade each pixel once from AOVs, so LANES and RESOLVED are 1. The user's text defines
//
//   float4 shade(const Surface s, const Scene scene);
//
// ATTRIBUTES   text, not a file: declares the further attributes of the frame
// USER_SHADER  text, not a file: the user's

#include "arithmetic/reals.h"
#include "arithmetic/vectors.h"
#include "shading/surface.h"
#include "shading/gbuffer.h"
#include "shading/light.h"
#include ATTRIBUTES

typedef struct {
  float3 position, normal, albedo;  // eye space: x right, y down, z forward
  float3 to_eye;                    // unit
  float depth;                      // eye z
  int x, y;                         // the pixel in the image
  Attributes attribute;
  Pixels pixels;
  surfaces exact;
} Surface;

typedef struct {
  int num_lights;
  float time;  // seconds
  float ambient, diffuse, specular, shininess;
  constant PhongLight *lights;
} Scene;

typedef struct {
  float3 toward;  // unit, toward the light
  float3 color;
} Light;

static inline float3 as_float3_of(reals3 v) { return (float3)((float)v.x, (float)v.y, (float)v.z); }

// A window of a supersampled image has a margin of this many pixels. The pixel itself replaces a neighbor beyond it.
#define FARTHEST_NEIGHBOR 8
static inline int is_near(int dx, int dy)
{
  return (dx >= -FARTHEST_NEIGHBOR) & (dx <= FARTHEST_NEIGHBOR) & (dy >= -FARTHEST_NEIGHBOR) &
         (dy <= FARTHEST_NEIGHBOR);
}

// Eye z at a neighboring pixel, +inf where there is no surface; outside the image the pixel's own.
static inline float depth_at(const Surface s, int dx, int dy)
{
  const int near = is_near(dx, dy);
  return (float)depths_at(&s.pixels, near ? dx : 0, near ? dy : 0);
}

// The normal at a neighboring pixel, 0 where there is no surface.
static inline float3 normal_at(const Surface s, int dx, int dy)
{
  const int near = is_near(dx, dy);
  return as_float3_of(normals_at(&s.pixels, near ? dx : 0, near ? dy : 0));
}

// Light i = 0 ... scene.num_lights - 1 as it arrives at s.
static inline Light light_at(const Surface s, const Scene scene, int i)
{
  const Arriving a = arriving(&s.exact, scene.lights + i);
  return (Light){as_float3_of(a.toward), as_float3_of(a.color)};
}

#include USER_SHADER

kernel void user_shader(constant View *view, constant Shading *shading, constant PhongLight *lights, real time,
                        GBUFFER, global real *color ATTRIBUTE_ARGUMENTS LIGHT_ARGUMENTS)
{
  const Pixels at = {AS_GBUFFER, view, get_global_id(0), get_global_id(1)};
  const long p = (long)at.y * view->width + at.x;
  Surface s;
  s.exact = surface_at(&at);
  TAKE_LIGHT_ARGUMENTS(s.exact);
  float4 rgba = (float4)(0.0f, 0.0f, 0.0f, 0.0f);
  if (s.exact.covered) {
    s.position = as_float3_of(s.exact.position);
    s.normal = as_float3_of(s.exact.normal);
    s.albedo = as_float3_of(s.exact.albedo);
    s.to_eye = as_float3_of(s.exact.to_eye);
    s.depth = (float)s.exact.position.z;
    s.x = at.x + view->first_column;
    s.y = at.y + view->first_row;
    s.attribute = ATTRIBUTES_AT(p);
    s.pixels = at;
    const Scene scene = {shading->num_lights, (float)time, (float)shading->ambient, (float)shading->diffuse,
                         (float)shading->specular, (float)shading->shininess, lights};
    rgba = shade(s, scene);
  }
  color[4 * p] = rgba.x;
  color[4 * p + 1] = rgba.y;
  color[4 * p + 2] = rgba.z;
  color[4 * p + 3] = rgba.w;
}
