"""OpenCL devices, programs and arithmetic; knows no splat."""
