"""The passes in OpenCL; draw.py runs them in order, so read it first."""
