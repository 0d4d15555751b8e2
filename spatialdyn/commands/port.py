"""``spatialdyn port PATH ...``: Pinocchio's names in scripts and notebooks, what stops them, and the lines to change.

Lines of a notebook are counted through its code cells, one after the other.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterable, Iterator
from importlib.util import decode_source
from pathlib import Path
from typing import Any, NamedTuple

from ..compat.pinocchio.coverage.porting import Change, Use, changes, uses
from ..compat.pinocchio.coverage.stops import FOREIGN, KINDS, LIBRARY, OLD, Stop, stops
from ..errors import SpatialDynError
from .printing import Column, print_table

SHOWN = 6  # lines or files listed per name
SUFFIXES = (".py", ".ipynb")
MAGIC = ("%", "!", "?")  # begin or end lines of notebooks that are not Python
LEFT_OUT = {"__pycache__", "build", "dist", "node_modules", "site-packages"}  # folders that are not read


class Script(NamedTuple):
    """A script: the names of Pinocchio that it uses, the imports to change, and the reasons that stop it."""

    path: str
    uses: list[Use]
    changes: list[Change]
    stops: list[Stop]

    @property
    def kinds(self) -> set[str]:
        """The kinds of reasons that stop the script."""
        return {stop.kind for stop in self.stops}

    @property
    def runs(self) -> bool:
        """Whether the script runs: no reason that counts stops it."""
        return not any(stop.counts for stop in self.stops)

    @property
    def working(self) -> int:
        """The number of names that work."""
        return sum(use.works for use in self.uses)

    def listed(self) -> dict[str, object]:
        """Whether it runs, with its uses, stops and changes, as names and numbers."""
        parts: dict[str, list[Any]] = {"uses": self.uses, "stops": self.stops, "changes": self.changes}
        return {"runs": self.runs, **{name: [x._asdict() for x in part] for name, part in parts.items()}}


def add(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments to its parser."""
    parser.add_argument("path", nargs="+", help="a Python file or notebook, or a folder of them")
    parser.add_argument(
        "--json",
        action="store_true",
        help="print JSON: for each file its names, what stops it, and the lines to change",
    )
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> int:
    """Returns 1 if something stops a script, such as a name that is not supported, else 0."""
    scripts: list[Script] = []
    for given in arguments.path:
        folder = Path(given).is_dir()
        read, faults = _folder(Path(given)) if folder else ([_script(Path(given))], [])
        scripts += read
        if not (read or faults):
            raise SpatialDynError(f'folder "{given}" has no Python files or notebooks')
        for fault in faults:
            print(f"not read: {fault}", file=sys.stderr if arguments.json else sys.stdout)
        if arguments.json:
            continue
        if folder:
            _print_folder(given, read)
        else:
            _print(read[0])
    if arguments.json:
        print(json.dumps({script.path: script.listed() for script in scripts}, indent=2))
    return int(any(script.changes and (not script.runs or OLD in script.kinds) for script in scripts))


def _script(path: Path) -> Script:
    try:
        source = _source(path)
        found = uses(source)
        return Script(str(path), found, changes(source), stops(source, found))
    except (OSError, UnicodeDecodeError, SyntaxError) as error:
        reason = error.strerror if isinstance(error, OSError) else "its characters cannot be decoded"
        raise SpatialDynError(f'script "{path}": {reason}, expected a Python file') from None
    except SpatialDynError as error:
        raise SpatialDynError(f'script "{path}": {error}') from None


def _source(path: Path) -> str:
    """The Python text of a script, or of the code cells of a notebook. Raises SpatialDynError for no notebook."""
    data = path.read_bytes()
    if path.suffix != ".ipynb":
        return decode_source(data)  # as Python reads it: a byte order mark, a coding comment
    try:
        cells = ["".join(cell["source"]) for cell in json.loads(data)["cells"] if cell["cell_type"] == "code"]
    except (ValueError, KeyError, TypeError, RecursionError):
        raise SpatialDynError("it is no notebook of format 4, expected cells") from None
    lines = [line for cell in cells for line in cell.splitlines()]
    return "\n".join(_without_magic(line) for line in lines)


def _without_magic(line: str) -> str:
    bare = line.lstrip()
    return line[: len(line) - len(bare)] + "pass" if bare.startswith(MAGIC) else line


def _folder(folder: Path) -> tuple[list[Script], list[str]]:
    """The scripts below a folder, and the faults of those that cannot be parsed; hidden folders are left out."""
    scripts, faults = [], []
    for path in sorted(x for suffix in SUFFIXES for x in folder.rglob(f"*{suffix}") if x.is_file()):
        parts = path.relative_to(folder).parts[:-1]
        if LEFT_OUT & {*parts} or any(part.startswith(".") for part in parts):
            continue
        try:
            scripts.append(_script(path))
        except SpatialDynError as error:
            faults.append(str(error))
    return scripts, faults


# --- printing ----------------------------------------------------------------------------------------------


def _print(script: Script) -> None:
    if not (script.uses or script.changes):
        print(f"{script.path}: uses nothing of Pinocchio")
        return
    rows = [(use.name, use.status, _listed(map(str, use.lines)), use.note) for use in script.uses]
    columns = (Column("name"), Column("status"), Column("lines"), Column("note"))
    print_table(columns, rows, [k for k, use in enumerate(script.uses) if not use.works])
    for use in script.uses:
        if use.works and use.raises:
            print(f"warning: {use.name}, line {_listed(map(str, use.lines))}, raises {use.raises}")
    print(f"{script.path}: {_share([script])}")
    for stop in script.stops:
        if stop.kind != FOREIGN:
            print(f"stopped by {stop.kind}: {stop.what}, line {_listed(map(str, stop.lines))}")
    for text in _advice(script):
        print(text)


def _print_folder(folder: str, scripts: list[Script]) -> None:
    used = [script for script in scripts if script.uses or script.changes]
    if not used:
        print(f"{folder}: none of {len(scripts)} files uses Pinocchio")
        return
    rows = []
    for script in used:
        missing, risky = len(script.uses) - script.working, sum(use.works and bool(use.raises) for use in script.uses)
        share = f"{100 * script.working // len(script.uses)} %" if script.uses else ""
        kinds = ", ".join(kind for kind in KINDS if kind in script.kinds)
        rows.append((_below(folder, script), str(len(script.uses)), str(missing), str(risky), share, kinds))
    columns = (Column("file"), Column("names", True), Column("missing", True), Column("may raise", True))
    bad = [k for k, script in enumerate(used) if not script.runs]
    print_table((*columns, Column("work", True), Column("stopped by")), rows, bad)
    noted: dict[tuple[str, str, str], list[str]] = {}
    for script in used:
        for use in script.uses:
            if not use.works or use.raises:
                key = (use.name, use.status, use.note if not use.works else f"raises {use.raises}")
                noted.setdefault(key, []).append(f"{_below(folder, script)}:{use.lines[0]}")
    if noted:
        print()
        listed = sorted(noted)
        print_table(
            (Column("name"), Column("status"), Column("first lines"), Column("note")),
            [(name, status, _listed(noted[name, status, note]), note) for name, status, note in listed],
            [k for k, (_, status, _) in enumerate(listed) if "supported" not in status],
        )
    rest = f"; files without Pinocchio: {len(scripts) - len(used)}" if len(scripts) > len(used) else ""
    print(f"{folder}: {_share(used)} in {len(used)} files{rest}")
    print(f"{folder}: {_count(used)}")
    lines = {text for script in used for text in _advice(script, numbered=False)}
    for text in sorted(lines):
        print(text)


def _share(scripts: Iterable[Script]) -> str:
    """How many of the names work."""
    names = {use.name: use.works for script in scripts for use in script.uses}
    working, count = sum(names.values()), len(names)
    text = f"{working} of {count} names work ({100 * working // max(1, count)} %)"
    return text if working == count else f"{text}, {count - working} missing"


def _count(scripts: list[Script]) -> str:
    """The number of files that run, and the reasons that stop others; files beside a C++ library are counted apart."""
    apart = sum(LIBRARY in script.kinds for script in scripts)
    rest = [script for script in scripts if LIBRARY not in script.kinds]
    run = [script for script in rest if script.runs]
    later = sum(FOREIGN in script.kinds for script in run)
    parts = [f"{len(run)} of {len(rest)} files run ({100 * len(run) // max(1, len(rest))} %)"]
    parts += [f"{later} of them after spatialdyn.compat.pinocchio.install(), by spatialdyn run"] * bool(later)
    stopped = {kind: sum(kind in script.kinds for script in rest) for kind in KINDS if kind not in (LIBRARY, FOREIGN)}
    parts += [f"{'with' if kind == OLD else 'stopped by'} {kind}: {n}" for kind, n in stopped.items() if n]
    parts += [f"beside a C++ library that links Pinocchio: {apart} more"] * bool(apart)
    return "; ".join(parts)


def _advice(script: Script, numbered: bool = True) -> Iterator[str]:
    """The lines to change."""
    for change in script.changes:
        where = f"line {change.line}" if numbered else "everywhere"
        yield f"change {where}: {change.before}  ->  {change.after}"
    for stop in script.stops:
        if stop.kind == FOREIGN:
            yield f"{stop.what} imports pinocchio itself: spatialdyn run, or install() before, gives it this package"


def _below(folder: str, script: Script) -> str:
    return str(Path(script.path).relative_to(folder))


def _listed(items: Iterable[str]) -> str:
    found = list(items)
    return ", ".join(found[:SHOWN]) + (", ..." if len(found) > SHOWN else "")
