// Shading pass: resolve the sums and light each pixel once, in eye space. Variants: SHADER, NUM_LIGHTS.

uniform sampler2D depth, color_sum, normal_sum;
uniform float depth_scale;
uniform vec2 focal, principal;
uniform vec4 material;  // ambient, diffuse, specular, shininess
#if NUM_LIGHTS
uniform vec4 light_place[NUM_LIGHTS];  // xyz 1: a position; xyz 0: a direction; 0 is a headlight at the eye
uniform vec3 light_color[NUM_LIGHTS];
#endif

out vec4 color;

vec3 phong(vec3 position, vec3 normal, vec3 albedo)
{
  vec3 to_eye = normalize(-position);
  vec3 rgb = albedo * material.x;
#if NUM_LIGHTS
  for (int i = 0; i < NUM_LIGHTS; ++i) {
    vec3 to_light = normalize(light_place[i].xyz - light_place[i].w * position);
    float n_l = dot(normal, to_light);
    if (n_l > 0.0) {
      float r_v = dot(2.0 * n_l * normal - to_light, to_eye);
      float highlight = pow(clamp(r_v, 0.0, 1.0), material.w);
      rgb += light_color[i] * (albedo * material.y * n_l + material.z * highlight);
    }
  }
#endif
  return rgb;
}

void main()
{
  ivec2 p = ivec2(gl_FragCoord.xy);
  vec4 c = texelFetch(color_sum, p, 0), n = texelFetch(normal_sum, p, 0);
  if (c.a <= 0.0) {
    color = vec4(0.0);
    return;
  }
  vec3 albedo = c.rgb / c.a;
  float length2 = dot(n.xyz, n.xyz);
  vec3 normal = length2 > 0.0 ? n.xyz * inversesqrt(length2) : vec3(0.0);
#if SHADER == ALBEDO
  color = vec4(albedo, 1.0);
#elif SHADER == NORMAL
  color = vec4(0.5 + 0.5 * normal * vec3(1.0, -1.0, -1.0), 1.0);
#else
  float z = texelFetch(depth, p, 0).r;
  if (z >= 1.0) z = n.w / c.a;  // no disc was hit, only the pre-filter landed
  vec3 position = vec3((gl_FragCoord.xy - principal) / focal, 1.0) * (z / depth_scale);
  color = vec4(phong(position, normal, albedo), 1.0);
#endif
}
