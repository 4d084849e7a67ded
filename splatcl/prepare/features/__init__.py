"""Splats that end at sharp edges ([ZRB04] section 5); `splatcl.features` holds the public names."""
