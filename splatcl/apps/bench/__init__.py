"""Measurements of speed: scenes, a table of configurations, timing, the machine's limits, reports (docs/bench.md)."""
