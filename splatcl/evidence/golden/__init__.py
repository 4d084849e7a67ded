"""Golden images: scenes whose AOVs have known hashes."""
