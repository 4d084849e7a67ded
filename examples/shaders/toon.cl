// Three tones of the light, and an outline where the depth jumps.
float4 shade(const Surface s, const Scene scene)
{
  float3 light = (float3)(scene.ambient);
  for (int i = 0; i < scene.num_lights; ++i) {
    const Light l = light_at(s, scene, i);
    const float n_l = dot(s.normal, l.toward);
    const float tone = n_l > 0.7f ? 1.0f : n_l > 0.3f ? 0.7f : 0.4f;
    light += l.color * tone;
  }
  for (int dy = -1; dy <= 1; ++dy)
    for (int dx = -1; dx <= 1; ++dx)
      if (depth_at(s, dx, dy) > 1.02f * s.depth) return (float4)(0.05f, 0.0f, 0.1f, 1.0f);  // nothing is infinitely far
  return (float4)(light * s.albedo, 1.0f);
}
