"""``python -m splatcl``."""

import sys

from splatcl.cli import main

sys.exit(main())
