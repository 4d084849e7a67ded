"""Programs on top of the library: the benchmark and the rerun of the papers."""
