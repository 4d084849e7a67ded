// Bin: a stable counting sort of the projected splats by tile, without atomics. Chunks are in splat order, so
// within each tile's run the records are too: sums are taken in increasing splat index.

// Splats of each tile, over all chunks.
kernel void bin_totals(global const int *tile_counts, global int *totals, const int num_chunks, const int num_tiles)
{
  const int tile = get_global_id(0);
  int total = 0;
  for (int chunk = 0; chunk < num_chunks; ++chunk) total += tile_counts[(long)chunk * num_tiles + tile];
  totals[tile] = total;
}

// Turn counts into the place where each chunk writes its first record of each tile of a band of tiles.
kernel void bin_offsets(global int *tile_counts, global const int *tile_begin, const int num_chunks,
                        const int num_tiles, const int first_tile)
{
  const int tile = first_tile + get_global_id(0);
  int offset = tile_begin[get_global_id(0)];
  for (int chunk = 0; chunk < num_chunks; ++chunk) {
    const int count = tile_counts[(long)chunk * num_tiles + tile];
    tile_counts[(long)chunk * num_tiles + tile] = offset;
    offset += count;
  }
}

// Copy each record into the runs of the tiles [first_tile, last_tile) that it touches.
kernel void bin_scatter(global const ProjectedSplat *records, global const SplatAttributes *attributes,
                        global const int *num_survivors, const int chunk_size, global int *tile_offsets,
                        global ProjectedSplat *run_records, global SplatAttributes *run_attributes,
                        const int tiles_x, const int num_tiles, const int first_tile, const int last_tile)
{
  const int chunk = get_global_id(0);
  const int begin = chunk * chunk_size, end = begin + num_survivors[chunk];
  global int *offsets = tile_offsets + (long)chunk * num_tiles;
  for (int i = begin; i < end; ++i) {
    const ProjectedSplat record = records[i];
    const SplatAttributes attribute = attributes[i];
    for (int ty = record.y_min / TILE; ty <= record.y_max / TILE; ++ty)
      for (int tx = record.x_min / TILE; tx <= record.x_max / TILE; ++tx) {
        const int tile = ty * tiles_x + tx;
        if (tile < first_tile || tile >= last_tile) continue;
        const int place = offsets[tile]++;
        run_records[place] = record;
        run_attributes[place] = attribute;
      }
  }
}
