// A drawing: the more the normal turns from pixel to pixel, the darker. White paper, ridges and furrows in blue.
float4 shade(const Surface s, const Scene scene)
{
  float turn = 0.0f;
  for (int dy = -1; dy <= 1; ++dy)
    for (int dx = -1; dx <= 1; ++dx) {
      const float3 normal = normal_at(s, dx, dy);
      if (dot(normal, normal) > 0.0f) turn = fmax(turn, 1.0f - dot(normal, s.normal));
    }
  const float ink = smoothstep(0.02f, 0.3f, turn);
  return (float4)(mix((float3)(1.0f, 1.0f, 0.97f), (float3)(0.05f, 0.1f, 0.35f), ink), 1.0f);
}
