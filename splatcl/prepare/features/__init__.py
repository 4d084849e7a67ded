"""Splats that end at sharp edges ([ZRB04] section 4); `splatcl.features` holds the public names."""
