"""Reading and writing: one file per format family."""

from splatcl.io.formats import read, up_axis
from splatcl.io.native import write
from splatcl.io.summary import Summary, inspect

__all__ = ["Summary", "inspect", "read", "up_axis", "write"]
