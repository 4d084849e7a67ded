// One point per splat: where it is on the screen and the coefficients of its disc, for either raster pass.
// Spaces as splatcl's: eye x right, y down, z forward; raster y down. The image's first row is GL's lowest row, so
// that gl_FragCoord.xy is the raster position. Variants: ATTRIBUTES, PREFILTER, FACING, CUTS_DEPTH, QUADS.

uniform mat3 rotation;     // eye from world
uniform vec3 translation;  // the same, of the origin that centers are relative to
uniform vec2 focal, principal, image_size;
uniform vec2 depth_range;  // near, far
uniform float depth_scale;  // a power of two that takes every z below 1, so that the depth buffer rounds nothing
uniform float prefilter_radius;
uniform float largest_point;  // pixels

in vec3 center, tangent_u, tangent_v;

flat out vec4 uv_form;     // u = uv_form.xy . d / den and v = uv_form.zw . d / den, d from the projected center
flat out vec4 den_center;  // den = 1 + den_center.xy . d; the projected center
#ifdef ATTRIBUTES
in vec3 color;
flat out vec4 color_z;            // color; z of the center, scaled
flat out vec4 normal_unfiltered;  // normal; 2 where the splat has no pre-filter, else 0
#else
flat out float z_center;  // scaled
#endif

const float EDGE_ON = 1.0 / 65536.0;  // |cos| between the normal and the line of sight up to which no disc is hit
const float CLEAR = 1e-4;             // bounds are a cut box where the least z is below this share of the center's
const float SLACK = 1.0 / 64.0;       // pixels: rounding of bounds here and of points in the rasterizer
const float OUTSIDE = 1e9;            // a coefficient that puts every pixel outside the disc
const vec4 NOWHERE = vec4(OUTSIDE, OUTSIDE, -OUTSIDE, -OUTSIDE);
const float SMALLEST = 1e-3;  // pixels

#ifdef CUTS_DEPTH
// Bounds of the disc's box in eye space, cut at near and projected.
vec4 cut_box(vec3 c, vec2 reach, float z_low, float z_high)
{
  vec2 low = c.xy - reach, high = c.xy + reach;
  low /= mix(vec2(z_high), vec2(z_low), lessThan(low, vec2(0.0)));
  high /= mix(vec2(z_low), vec2(z_high), lessThan(high, vec2(0.0)));
  return vec4(low, high) * focal.xyxy + principal.xyxy;
}
#endif

// Bounds of the projected disc: x_min y_min x_max y_max, raster.
vec4 disc_bounds(vec3 c, vec3 t_u, vec3 t_v, vec2 center_raster)
{
  float reach = length(vec2(t_u.z, t_v.z));
  float w = (c.z - reach) * (c.z + reach);
  vec2 slope = c.xy / c.z;
  vec2 p_u = t_u.xy - slope * t_u.z, p_v = t_v.xy - slope * t_v.z;
  vec2 p_z = p_u * t_u.z + p_v * t_v.z;
  vec2 to_pixels = focal / w;
  vec2 middle = center_raster - p_z * to_pixels;
  vec2 extent = sqrt(p_z * p_z + (p_u * p_u + p_v * p_v) * w) * to_pixels;
  vec4 bounds = vec4(middle - extent, middle + extent);
#ifdef CUTS_DEPTH
  if (c.z + reach < depth_range.x || c.z - reach > depth_range.y) return NOWHERE;
  if (c.z < depth_range.x || c.z - reach < c.z * CLEAR)
    bounds = cut_box(c, sqrt(t_u.xy * t_u.xy + t_v.xy * t_v.xy), max(c.z - reach, depth_range.x), c.z + reach);
#endif
  return bounds;
}

// Cover the pixels whose centers the bounds hold with the smallest point, or, where that would be larger than GL has
// points, with a rectangle (QUADS, a second draw call that most frames don't need). A point's center is inside the
// image, so that GL does not clip it. What is not drawn goes to the image's corner rather than outside: where a draw
// call has points to clip, Mesa takes a slower path for all of them.
void cover(vec4 bounds)
{
  vec2 first = ceil(max(bounds.xy - SLACK, 0.0) - 0.5), last = floor(min(bounds.zw + SLACK, image_size) - 0.5);
  vec2 size = last - first + 1.0;
  float largest = max(size.x, size.y);
  bool drawn = min(size.x, size.y) >= 1.0;
#ifdef QUADS
  drawn = drawn && largest > largest_point;
  vec2 place = mix(first, last + 1.0, vec2(gl_VertexID & 1, gl_VertexID >> 1));
#else
  drawn = drawn && largest <= largest_point;
  vec2 place = (first + last + 1.0) * 0.5;
  gl_PointSize = drawn ? largest : SMALLEST;
#endif
  gl_Position = vec4(drawn ? 2.0 * place / image_size - 1.0 : vec2(-1.0), 0.0, 1.0);
}

void main()
{
  vec3 c = rotation * center + translation;
  vec3 t_u = rotation * tangent_u, t_v = rotation * tangent_v;
  vec3 g = cross(t_u, t_v);
  float facing = dot(g, c);  // >= 0: the splat faces away
  bool culled = FACING == CULL && facing >= 0.0;
  bool edge_on = facing * facing <= EDGE_ON * EDGE_ON * dot(g, g) * dot(c, c);
  vec2 center_raster = c.xy / c.z * focal + principal;

  vec2 scale = c.z / facing / focal;
  uv_form = vec4(cross(t_v, c).xy * scale, cross(c, t_u).xy * scale);
  den_center = vec4(g.xy * scale, center_raster);
  vec4 bounds = disc_bounds(c, t_u, t_v, center_raster);
  if (culled || edge_on) {
    uv_form = vec4(OUTSIDE, 0.0, 0.0, OUTSIDE);
    den_center.xy = vec2(0.0);
    bounds = NOWHERE;
  }
#ifdef ATTRIBUTES
  color_z = vec4(color, c.z * depth_scale);
  normal_unfiltered = vec4(normalize(FACING == FLIP && facing >= 0.0 ? -g : g), 2.0);
#if PREFILTER
  bool filtered = !culled;
#ifdef CUTS_DEPTH
  filtered = filtered && c.z >= depth_range.x && c.z <= depth_range.y;
#endif
  if (filtered) {
    normal_unfiltered.w = 0.0;
    bounds = vec4(min(bounds.xy, center_raster - prefilter_radius), max(bounds.zw, center_raster + prefilter_radius));
  }
#endif
#else
  z_center = c.z * depth_scale;
#endif
  cover(bounds);
}
