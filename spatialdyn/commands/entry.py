"""The start of the command line: long imports run here, where Ctrl-C ends them with one line, as any other work."""

from __future__ import annotations

import sys
from contextlib import suppress

from ..engines.interrupt import INTERRUPTED, leave


def main() -> int:
    """Run the command line and return its exit status; after Ctrl-C exit at once, even while LLVM compiles."""
    try:
        from .cli import main as run

        status = run()
    except KeyboardInterrupt:
        print("spatialdyn: interrupted", file=sys.stderr)
        status = INTERRUPTED
    if status == INTERRUPTED:
        for stream in (sys.stdout, sys.stderr):
            with suppress(OSError, ValueError, AttributeError):
                stream.flush()
        leave(status)
    return status
