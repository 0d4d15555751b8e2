"""``spatialdyn port SCRIPT.py``: which of Pinocchio's names a script uses, and which of them are supported."""

from __future__ import annotations

import argparse
import json
from collections import Counter
from pathlib import Path

from ..compat.pinocchio.coverage.coverage import DIFFERENT, SUPPORTED
from ..compat.pinocchio.coverage.porting import Use, uses
from ..errors import SpatialDynError
from .printing import Column, print_table

CHANGE = "import spatialdyn.compat.pinocchio as pin"
SHOWN = 6  # lines of the script listed per name


def add(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments to its parser."""
    parser.add_argument("script", nargs="+", help="a Python file")
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> int:
    """Returns 1 if a script uses a name that is not supported, else 0."""
    found = {script: _uses_of(script) for script in arguments.script}
    if arguments.json:
        print(json.dumps({script: [use._asdict() for use in used] for script, used in found.items()}, indent=2))
    else:
        for script, used in found.items():
            _print(script, used)
    return int(any(_missing(use) for used in found.values() for use in used))


def _uses_of(script: str) -> list[Use]:
    try:
        return uses(Path(script).read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not UTF-8"
        raise SpatialDynError(f'script "{script}": {reason}, expected a Python file') from None
    except SpatialDynError as error:
        raise SpatialDynError(f'script "{script}": {error}') from None


def _missing(use: Use) -> bool:
    return use.status not in (SUPPORTED, DIFFERENT)


def _print(script: str, used: list[Use]) -> None:
    if not used:
        print(f"{script}: uses nothing of Pinocchio")
        return
    rows = []
    for use in used:
        lines = ", ".join(map(str, use.lines[:SHOWN])) + (", ..." if len(use.lines) > SHOWN else "")
        rows.append((use.name, use.status, lines, use.note))
    columns = (Column("name"), Column("status"), Column("lines"), Column("note"))
    print_table(columns, rows, [k for k, use in enumerate(used) if _missing(use)])
    counts = Counter("missing" if _missing(use) else use.status for use in used)
    print(f"{script}: {', '.join(f'{n} {what}' for what, n in counts.items())}")
    if not counts["missing"]:
        print(f"change one line: {CHANGE}")
