// A hologram: lines that creep down the image, a brighter band that runs over it once in two seconds, a rim of light.
float4 shade(const Surface s, const Scene scene)
{
  const float facing = fabs(dot(s.normal, s.to_eye));
  const float height = s.position.y / s.depth;  // of the view, whatever the image's size
  const float line = 0.6f + 0.4f * sin(400.0f * height - 6.0f * scene.time);
  const float down = height - 0.5f * scene.time;
  const float from_band = down - floor(down) - 0.5f;
  const float band = exp(-200.0f * from_band * from_band);
  const float glow = line * (0.25f + 0.75f * (1.0f - facing) * (1.0f - facing)) + band;
  return (float4)(glow * (float3)(0.1f, 0.8f, 1.0f), 1.0f);
}
