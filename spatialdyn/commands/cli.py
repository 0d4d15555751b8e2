"""The command line: ``spatialdyn info ROBOT``, ``compare [ROBOT ...|--all]``, ``derive ROBOT``, ``simulate ROBOT``,
``check ROBOT``, ``trade ROBOT``, ``port SCRIPT``.

Exit status: 0 all is well, 1 disagreement with Pinocchio, or a script uses what is not there, 2 bad input, which is
said on stderr in one line, 130 Ctrl-C, likewise.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from .. import __version__
from ..errors import SpatialDynError
from . import check, compare, derive, info, port, simulate, trade

INTERRUPTED = 130  # 128 and the number of the signal, as shells have it


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit status; ``argv`` is ``sys.argv[1:]`` by default."""
    for stream in (sys.stdout, sys.stderr):  # a pipe may know less than the terminal: print what it has for the rest
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")
    arguments = _parser().parse_args(argv)
    try:
        status: int = arguments.run(arguments)
    except SpatialDynError as error:
        print(f"spatialdyn: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt as interrupt:
        print(f"spatialdyn: {str(interrupt) or 'interrupted'}", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:  # the reader, head say, has seen enough
        sys.stderr.close()
        return 0
    return status


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="spatialdyn", description="Rigid-body dynamics of robots described by a URDF."
    )
    parser.add_argument("--version", action="version", version=f"%(prog)s {__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    for command in (info, check, derive, compare, simulate, trade, port):
        command.add(commands)
    return parser
