"""``spatialdyn compile ROBOT``: compiles its calls ahead, so that none waits: for containers, robots and CI."""

from __future__ import annotations

import argparse

from ..calls.prepare import compile_calls
from .printing import shown
from .robots import add_quiet, add_robot, load


def add(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments to its parser."""
    add_robot(parser)
    parser.add_argument("--calls", metavar="NAMES", help="names of calls, separated by commas (default: all)")
    parser.add_argument("--frame", metavar="FRAME", help="also the calls of a frame, for this one")
    parser.add_argument("--reference", default="local", metavar="R", help="of those calls (default: local)")
    parser.add_argument("--fext", action="store_true", help="with external forces, where a call takes them")
    add_quiet(parser)
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> int:
    names = None if arguments.calls is None else [name.strip() for name in arguments.calls.split(",")]
    with shown("compiling", "calls", arguments.quiet) as report:
        model = load(arguments, mimic=True)
        seconds = compile_calls(
            model, names, arguments.frame, arguments.reference, fext=arguments.fext, progress=report
        )
    print(f"{model.name}: {len(seconds)} calls are compiled, in {sum(seconds.values()):.1f} s")
    return 0
