// The light map: for each direction on a square (octahedral.h), the light on a surface with this normal, sum L max(N.L,
// 0), and on one that mirrors the eye in this direction, sum L (R.L)^shininess over R.L > 0.
//
// Every light is a direction here; a headlight's is toward the eye. A work-item takes LANES samples of a row.
//
// LIGHTMAP  samples of the square each way

#include "arithmetic/reals.h"
#include "arithmetic/vectors.h"
#include "arithmetic/exponential.h"
#include "arithmetic/lanes.h"
#include "shading/octahedral.h"

static inline reals3 direction_to(constant PhongLight *light)
{
  reals3 place = {light->x, light->y, light->z};
  if (light->is_point > R(0.0)) place.z = (reals)R(-1.0);  // at the eye, x = y = 0
  return normalize3(place);
}

kernel void lightmap(constant Shading *shading, constant PhongLight *lights, global real *table)
{
  const int x = get_global_id(0) * LANES, y = get_global_id(1), num = least(LANES, LIGHTMAP - x);
  reals columns;
  for (int lane = 0; lane < LANES; ++lane) ((real *)&columns)[lane] = (real)(x + least(lane, num - 1));
  const reals3 d = direction_of(columns, (reals)(real)y);
  reals3 diffuse = scale3(d, R(0.0)), specular = diffuse;  // not a constant: rusticl copies it wrongly
  for (int i = 0; i < shading->num_lights; ++i) {
    const reals3 tint = {lights[i].red, lights[i].green, lights[i].blue};
    const reals cosine = dot3(d, direction_to(lights + i));
    const masks above = MASK(cosine > R(0.0));
    if (!ANY(above)) continue;
    const reals shine = SELECT(R(0.0), power(at_most(cosine, R(1.0)), shading->shininess), above);
    diffuse = add3(diffuse, scale3(tint, at_least(cosine, R(0.0))));
    specular = add3(specular, scale3(tint, shine));
  }
  for (int lane = 0; lane < num; ++lane) {
    global real *to = table + 6 * (y * LIGHTMAP + x + lane);
    to[0] = LANE_OF(diffuse.x, lane);
    to[1] = LANE_OF(diffuse.y, lane);
    to[2] = LANE_OF(diffuse.z, lane);
    to[3] = LANE_OF(specular.x, lane);
    to[4] = LANE_OF(specular.y, lane);
    to[5] = LANE_OF(specular.z, lane);
  }
}
