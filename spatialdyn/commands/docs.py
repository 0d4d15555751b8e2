"""``spatialdyn docs``: the site about this library, built into a folder."""

from __future__ import annotations

import argparse

from ..docs.site import build
from .printing import shown


def add(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments to its parser."""
    parser.add_argument("--output", metavar="FOLDER", default="spatialdyn-docs", help="where to; spatialdyn-docs here")
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> int:
    with shown("building", "pages"):
        first = build(arguments.output)
    print(f"built   {first}")
    return 0
