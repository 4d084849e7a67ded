"""Evidence: what can be proved about a frame or a device."""
