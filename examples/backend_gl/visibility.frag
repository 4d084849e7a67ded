// Visibility pass: the nearest z of the discs that the pixel's ray hits. The pre-filter takes no part.

uniform vec2 scaled_range;  // near, far times depth_scale

flat in vec4 uv_form, den_center;
flat in float z_center;

void main()
{
  vec2 d = gl_FragCoord.xy - den_center.zw;
  float den = 1.0 + dot(den_center.xy, d);
  vec2 uv = vec2(dot(uv_form.xy, d), dot(uv_form.zw, d));
  if (!(dot(uv, uv) <= den * den)) discard;
  float z = z_center * (1.0 / den);  // as the attribute pass rounds it
#ifdef CUTS_DEPTH
  if (z < scaled_range.x || z > scaled_range.y) discard;
#endif
  gl_FragDepth = z;
}
