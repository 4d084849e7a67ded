"""Reading and writing: one file per format family."""

from splatcl.io.read import read, up_axis
from splatcl.io.write import write
from splatcl.io.inspect import Summary, inspect

__all__ = ["Summary", "inspect", "read", "up_axis", "write"]
