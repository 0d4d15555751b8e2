"""``spatialdyn compare [ROBOT ...|--all]``: errors and times of every call against Pinocchio."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from ..calls.json_numbers import finite_or_none
from ..errors import SpatialDynError, pip_install
from ..urdf.load import example_robots, robot_names
from ..validate import Comparison, Row, compare_with_pinocchio, pinocchio, pinocchio_model
from .printing import Column, fold, print_table, progress, shown
from .robots import ROBOT, ROOTS, add_quiet

TIMED = ("rnea", "crba", "aba")


def add(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments to its parser."""
    parser.add_argument("robots", metavar="ROBOT", nargs="*", help=ROBOT)
    parser.add_argument("--all", action="store_true", help="every robot of example-robot-data")
    parser.add_argument("--samples", type=int, default=20, metavar="N", help="random states each (default: 20)")
    parser.add_argument("--calls", metavar="NAMES", help="names of calls, separated by commas (default: all)")
    parser.add_argument("--no-timing", dest="timing", action="store_false", help="errors only")
    parser.add_argument("--json", action="store_true", help="print JSON")
    add_quiet(parser)
    parser.set_defaults(run=_run)


class _Compared(NamedTuple):
    """A robot under its name on the command line: its comparisons by root, or the reason why no library loads it."""

    label: str
    by_root: dict[str, Comparison]
    refused: str = ""

    @property
    def ok(self) -> bool:
        return all(comparison.ok for comparison in self.by_root.values())


def _run(arguments: argparse.Namespace) -> int:
    pinocchio()
    if arguments.all == bool(arguments.robots):
        raise SpatialDynError("compare takes either robots or --all")
    if arguments.all and not example_robots():
        raise SpatialDynError(f"example-robot-data is not installed; {pip_install('validate')}")
    examples = set(example_robots())
    sources = {name: name for name in arguments.robots}
    if arguments.all:
        sources = {name: str(path) for name, path in robot_names().items() if path in examples}
    found: list[_Compared] = []
    if len(sources) == 1:
        with shown("comparing", "calls", arguments.quiet) as report:
            found += [_compared(label, source, arguments, report) for label, source in sources.items()]
    else:
        with progress(len(sources), arguments.quiet) as begin:
            for label, source in sources.items():
                begin(label)
                found.append(_compared(label, source, arguments))
    ok = all(robot.ok for robot in found)
    if arguments.json:
        print(json.dumps([_record(robot) for robot in found], indent=2, ensure_ascii=False))
    else:
        if len(found) == 1:
            _show_one(found[0])
        else:
            _show_many(found, arguments.timing)
        print(_verdict(found, "every call" if arguments.calls is None else "every call asked for"))
    return 0 if ok else 1


def _compared(
    label: str, source: str, arguments: argparse.Namespace, report: Callable[[int, int], None] | None = None
) -> _Compared:
    """Compare both roots of a robot. With ``--all``, a robot that Pinocchio does not load either is no failure."""
    by_root = {}
    calls = None if arguments.calls is None else [name.strip() for name in arguments.calls.split(",")]
    try:
        for k, root in enumerate(ROOTS):

            def both(done: int, total: int, k: int = k) -> None:
                if report is not None:
                    report(done + k * total, len(ROOTS) * total)

            by_root[root] = compare_with_pinocchio(
                source, root, samples=arguments.samples, timing=arguments.timing, progress=both, calls=calls
            )
        return _Compared(label, by_root)
    except SpatialDynError as error:
        if arguments.all and not _loads_in_pinocchio(source):
            return _Compared(label, {}, str(error))
        raise


def _loads_in_pinocchio(source: str) -> bool:
    try:
        pinocchio_model(source)
    except SpatialDynError:
        return False
    return True


def _error(row: Row | None) -> str:
    """An error as 1.2e-15, a star where a note explains it."""
    if row is None:
        return ""
    text = "-" if row.error is None else "0" if row.error == 0.0 else f"{row.error:.1e}"
    return text + ("*" if row.note else " ")


def _time(value: float | None) -> str:
    return "" if value is None else f"{value:.2f}"


def _rows(comparison: Comparison | None) -> dict[str, Row]:
    return {} if comparison is None else {row.call: row for row in comparison.rows}


def _show_one(robot: _Compared) -> None:
    """A row per call."""
    timed_root = "fixed" if robot.by_root["fixed"].nv else "floating"
    rows = {root: _rows(comparison) for root, comparison in robot.by_root.items()}
    calls = list(dict.fromkeys(call for by_call in rows.values() for call in by_call))
    timing = any(row.ours_us for row in rows[timed_root].values())
    columns = [Column("call"), *(Column(f"{root} ", True) for root in ROOTS)]
    columns += [Column(title, True) for title in ("ours µs", "pin µs", "ratio")] * timing
    lines, bad = [], []
    for k, call in enumerate(calls):
        both = [rows[root].get(call) for root in ROOTS]
        line = [call, *map(_error, both)]
        timed = rows[timed_root].get(call)
        if timing:
            line += ["", "", ""] if timed is None else map(_time, (timed.ours_us, timed.pin_us, timed.ratio))
        lines.append(line)
        if any(row is not None and not row.ok for row in both):
            bad.append(k)
    sizes = ", ".join(f"{root} root nv {comparison.nv}" for root, comparison in robot.by_root.items())
    samples = robot.by_root["fixed"].samples
    fold(f"{robot.label}: {sizes}; {samples} random states; error = max |x - x_pin| / max(1, max |x_pin|)", "")
    print()
    print_table(columns, lines, bad)
    print()
    if timing:
        print(f"times: single calls from Python, {timed_root} root")
    _show_notes([robot])


def _show_many(robots: Sequence[_Compared], timing: bool) -> None:
    """A row per robot: the largest error for each root, the worst call of all, and ratios of times."""
    columns = [Column("robot"), Column("nv", True), *(Column(f"{root} ", True) for root in ROOTS)]
    timed_calls = [
        call for call in TIMED if timing and all(call in _rows(x) for r in robots for x in r.by_root.values())
    ]
    columns += [Column("worst call")] + [Column(call, True) for call in timed_calls]
    lines, bad = [], []
    for k, robot in enumerate(robots):
        if robot.refused:
            lines.append([robot.label, "", "", "", "refused by both", *[""] * len(timed_calls)])
            continue
        line = [robot.label, str(robot.by_root["fixed"].nv)]
        worst = [robot.by_root[root].worst for root in ROOTS]
        line += [*map(_error, worst), max(worst, key=lambda row: row.badness).call]
        timed = robot.by_root["fixed" if robot.by_root["fixed"].nv else "floating"]
        line += [_time(_rows(timed)[call].ratio) for call in timed_calls]
        lines.append(line)
        if not robot.ok:
            bad.append(k)
    print_table(columns, lines, bad)
    print()
    if timed_calls:
        fold(
            f"{', '.join(timed_calls)}: our time over Pinocchio's, single calls from Python, fixed root unless nv is 0",
            "",
        )
    _show_notes(robots)


def _show_notes(robots: Sequence[_Compared]) -> None:
    """Every note once, with its calls, roots and robots."""
    notes: dict[str, dict[str, list[str]]] = {}
    for robot in robots:
        if robot.refused:
            notes.setdefault(f"neither library loads it: {robot.refused}", {}).setdefault(robot.label, [])
        for root, comparison in robot.by_root.items():
            for row in comparison.rows:
                if row.note:
                    subject = f"{root} root" if len(robots) == 1 else f"{robot.label} ({root})"
                    notes.setdefault(row.note, {}).setdefault(subject, []).append(row.call)
    for note, about in notes.items():
        calls = ", ".join(dict.fromkeys(call for some in about.values() for call in some))
        fold(f"{', '.join(about)}{': ' * bool(calls)}{calls}: {note}", "* ")


def _verdict(robots: Sequence[_Compared], calls: str) -> str:
    """One line: AGREES, or DISAGREES with the calls that disagree."""
    failed = [
        f"{robot.label} ({root}): {row.call}"
        for robot in robots
        for root, comparison in robot.by_root.items()
        for row in comparison.rows
        if not row.ok
    ]
    compared = [robot for robot in robots if not robot.refused]
    if failed:
        more = f" and {len(failed) - 5} more" if len(failed) > 5 else ""
        return f"DISAGREES with Pinocchio: {'; '.join(failed[:5])}{more}"
    subject = compared[0].label if len(compared) == 1 else f"{len(compared)} robots"
    refused = len(robots) - len(compared)
    rest = f"; {refused} refused by both" if refused else ""
    return f"AGREES with Pinocchio: {subject}, {calls} within its bound{rest}"


def _record(robot: _Compared) -> dict[str, Any]:
    """The comparison of a robot as JSON types; a number that is not finite is None."""
    return {
        "robot": robot.label,
        "ok": robot.ok,
        "refused_by_both": robot.refused or None,
        "comparisons": [
            {
                "root": root,
                "nq": comparison.nq,
                "nv": comparison.nv,
                "samples": comparison.samples,
                "ok": comparison.ok,
                "rows": [
                    {
                        "call": row.call,
                        "error": finite_or_none(row.error),
                        "bound": row.bound,
                        "ok": row.ok,
                        "note": row.note,
                        "ours_us": row.ours_us,
                        "pin_us": row.pin_us,
                        "ratio": row.ratio,
                    }
                    for row in comparison.rows
                ],
            }
            for root, comparison in robot.by_root.items()
        ],
    }
