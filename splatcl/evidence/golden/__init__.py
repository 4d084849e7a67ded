"""Golden images: small scenes whose every AOV has a known hash, the same on every device."""
