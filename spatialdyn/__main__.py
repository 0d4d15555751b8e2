"""``python -m spatialdyn``: the command line."""

from __future__ import annotations

import sys

from .commands.entry import main

sys.exit(main())
