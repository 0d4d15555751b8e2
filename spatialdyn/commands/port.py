"""``spatialdyn port SCRIPT``: what a script uses of Pinocchio, and whether ``spatialdyn.compat.pinocchio`` has it."""

from __future__ import annotations

import argparse
from collections import Counter
from pathlib import Path
from typing import Any

from ..errors import SpatialDynError
from .printing import Column, print_table

MOST = 6  # lines of a script that are named


def add(commands: Any) -> None:
    """Register the command with what argparse's ``add_subparsers`` has given."""
    parser = commands.add_parser("port", help="what a script uses of Pinocchio, and what of it is here")
    parser.add_argument("script", metavar="SCRIPT", help="path of a Python script; it is read, not run")
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> int:
    """1 if something is missing, else 0. Raises SpatialDynError for a file that is no script."""
    from ..compat.pinocchio.port import FACE, uses

    path = Path(arguments.script)
    try:
        script = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise SpatialDynError(f"{path} cannot be read ({error}), expected a Python script") from None
    found = uses(script, path.name)
    if not found:
        print(f"{path.name} uses nothing of pinocchio")
        return 0
    rows = []
    for use in found:
        lines = ", ".join(map(str, use.lines[:MOST])) + (" ..." if len(use.lines) > MOST else "")
        rows.append((use.name, use.status, lines, use.note))
    missing = [k for k, use in enumerate(found) if use.status == "out of scope"]
    print_table([Column("name"), Column("status"), Column("lines"), Column("note")], rows, bad=missing)
    counts = Counter(use.status for use in found)
    print(", ".join(f"{n} {status}" for status, n in counts.items()))
    if not missing:
        print(f"change the import to: import {FACE} as pin")
    return 1 if missing else 0
