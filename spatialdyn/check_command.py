"""``spatialdyn check ROBOT``: what is odd about a robot, what it costs in digits and what helps."""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Callable
from typing import Any

from .trade.diagnose import diagnose
from .urdf import load_urdf


def add_check(commands: Any, robot: str, say: Callable[[str], None]) -> None:
    """Register the command.

    commands  what argparse's add_subparsers has given
    robot     help of the argument ROBOT
    say       writes a line where people read it
    """
    parser = commands.add_parser("check", help="inertias, mass ratios, digits and time steps: what is odd, what helps")
    parser.add_argument("robot", metavar="ROBOT", help=robot)
    parser.add_argument("--root", choices=("fixed", "floating"), default="fixed", help="the root link (default: fixed)")
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.set_defaults(run=lambda arguments: _run(arguments, say))


def _run(arguments: argparse.Namespace, say: Callable[[str], None]) -> int:
    """1 if there is an error among the findings, else 0."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # what it would say is among the findings
        model = load_urdf(arguments.robot, root=arguments.root)
    found = diagnose(model)
    say(found.to_json() if arguments.json else str(found))
    return 1 if found.severity == "error" else 0
