"""Margins and envelopes on the host, in float64 NumPy, from the oracle's equations."""
