// Attribute pass: add w, w color, w normal and w z of every fragment that is at most epsilon behind the visible depth.
// The depth test compares z - epsilon with that depth (LEQUAL, no writes); blending adds (ONE, ONE).

uniform vec2 scaled_range;         // near, far times depth_scale
uniform float scaled_epsilon;      // epsilon times depth_scale
uniform float inverse_radius2;     // 1 / prefilter_radius^2
uniform float exponent;            // w = 2^(exponent r^2)

flat in vec4 uv_form, den_center, color_z, normal_unfiltered;

layout(location = 0) out vec4 color_sum;   // w color; w
layout(location = 1) out vec4 normal_sum;  // w normal; w z

void main()
{
  vec2 d = gl_FragCoord.xy - den_center.zw;
  float inverse_den = 1.0 / (1.0 + dot(den_center.xy, d));
  vec2 uv = vec2(dot(uv_form.xy, d), dot(uv_form.zw, d)) * inverse_den;
  float r_squared = dot(uv, uv);
  float z = color_z.w * inverse_den;
#ifdef CUTS_DEPTH
  bool hit = r_squared <= 1.0 && z >= scaled_range.x && z <= scaled_range.y;
  r_squared = hit ? r_squared : 2.0;
#else
  bool hit = r_squared <= 1.0;
#endif
#if PREFILTER
  r_squared = min(r_squared, dot(d, d) * inverse_radius2 + normal_unfiltered.w);
  if (!hit) z = color_z.w;
#endif
  if (!(r_squared <= 1.0)) discard;
  float w = exp2(exponent * r_squared);
  color_sum = vec4(color_z.rgb, 1.0) * w;
  normal_sum = vec4(normal_unfiltered.xyz, z) * w;
  gl_FragDepth = z - scaled_epsilon;
}
