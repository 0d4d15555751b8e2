"""``spatialdyn check ROBOT``: oddities of a robot, the digits they cost and what helps."""

from __future__ import annotations

import argparse

from ..accuracy.diagnose import diagnose
from .printing import shown
from .robots import add_quiet, add_robot, load
from .targets import check_report


def add(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments to its parser."""
    add_robot(parser)
    parser.add_argument("--report", metavar="FILE", help="write one HTML page of it all, which needs no network")
    parser.add_argument("--json", action="store_true", help="print JSON")
    add_quiet(parser)
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> int:
    """Returns 1 if a finding is an error, else 0."""
    check_report(arguments.report)
    with shown("examining", "parts", arguments.quiet) as report:
        found = diagnose(load(arguments), progress=report)
    print(found.to_json() if arguments.json else str(found))
    if arguments.report:
        found.report(arguments.report)
        if not arguments.json:
            print(f"written {arguments.report}")
    return 1 if found.severity == "error" else 0
