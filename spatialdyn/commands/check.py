"""``spatialdyn check ROBOT``: what is odd about a robot, what it costs in digits and what helps."""

from __future__ import annotations

import argparse
from typing import Any

from ..accuracy.diagnose import diagnose
from .robots import add_robot, load


def add(commands: Any) -> None:
    """Register the command with what argparse's ``add_subparsers`` has given."""
    parser = commands.add_parser("check", help="inertias, mass ratios, digits and time steps: what is odd, what helps")
    add_robot(parser)
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> int:
    """1 if there is an error among the findings, else 0."""
    found = diagnose(load(arguments))
    print(found.to_json() if arguments.json else str(found))
    return 1 if found.severity == "error" else 0
