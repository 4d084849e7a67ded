"""OpenCL devices, programs, struct layouts and arithmetic; nothing here knows a splat."""
