"""Reading and writing: one file per format family."""

from splatcl.io.formats import Summary, inspect, read, up_axis
from splatcl.io.native import write

__all__ = ["Summary", "inspect", "read", "up_axis", "write"]
