"""`python -m clvox` is the command `clvox`."""

import sys

from clvox.cli import main

sys.exit(main())
