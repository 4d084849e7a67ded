"""Measure speed: scenes, a table of configurations, timing, the machine's limits, reports (docs/speed/bench.md)."""
