"""The passes on the device, one file each; kernels/passes has the kernel of the same name."""
