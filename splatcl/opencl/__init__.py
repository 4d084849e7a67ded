"""The passes in OpenCL; read draw.py first."""
