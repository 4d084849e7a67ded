"""The OpenCL sources, shipped in the wheel as splatcl.kernels."""
