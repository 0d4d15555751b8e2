"""The command line: ``spatialdyn info ROBOT``, ``compare [ROBOT ...|--all]``, ``derive ROBOT``, ``simulate ROBOT``,
``check ROBOT``.

Tables are drawn by rich if it is installed, as aligned text otherwise. Exit status: 0 all is well, 1 disagreement
with Pinocchio, 2 bad input, which is said on stderr in one line.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import math
import shutil
import sys
import warnings
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

from . import dynamics
from .check_command import add_check
from .errors import SpatialDynError
from .lagrangian.symbolic import QUANTITIES, SymbolicManipulator
from .model import Model
from .robot import Joint
from .simulate_command import add_simulate
from .specialize import specialize
from .urdf import example_robots, load_urdf, robot_names
from .validate import Comparison, Row, compare_with_pinocchio, pinocchio, pinocchio_model

ROOTS = ("fixed", "floating")
CALLS = {  # that a program is made of, by the names of QUANTITIES
    "M": "crba",
    "C": "coriolis_matrix",
    "g": "generalized_gravity",
    "christoffel": "christoffel_symbols",
    "T": "kinetic_energy",
    "V": "potential_energy",
    "H": "hamiltonian",
    "tau": "rnea",
    "qdot": "velocity_from_momentum",
}
TIMED = ("rnea", "crba", "aba")
WIDE = 400  # columns of a table that is not read in a terminal: nothing is folded


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
    except BrokenPipeError:  # the reader, head say, has seen enough
        sys.stderr.close()
        return 0
    return status


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="spatialdyn", description="Rigid-body dynamics of URDF robots: look at one, compare it with Pinocchio."
    )
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    robot = "path of a URDF, or the name of a robot of urdf/ or example-robot-data"

    info = commands.add_parser("info", help="what a robot is made of, and what is odd about its file")
    info.add_argument("robot", metavar="ROBOT", help=robot)
    info.add_argument("--root", choices=ROOTS, default="fixed", help="what the root link does (default: fixed)")
    info.add_argument("--json", action="store_true", help="print JSON")
    info.set_defaults(run=_info)

    derive = commands.add_parser("derive", help="M, C, g, energies in closed form")
    derive.add_argument("robot", metavar="ROBOT", help=robot)
    derive.add_argument("--root", choices=ROOTS, default="fixed", help="what the root link does (default: fixed)")
    derive.add_argument(
        "--quantity", default="M,C,g", metavar="LIST", help=f"of {', '.join(QUANTITIES)} (default: M,C,g)"
    )
    derive.add_argument("--format", choices=("text", "latex", "c", "python"), default="text", help="default: text")
    derive.add_argument("--symbols", action="store_true", help="masses, lengths, ... as symbols, not numbers")
    derive.add_argument(
        "--program",
        action="store_true",
        help="of any size of robot: c or python straight from the recursion, unsimplified, in the robot's numbers",
    )
    derive.set_defaults(run=_derive)

    compare = commands.add_parser("compare", help="errors and times of every call against Pinocchio")
    compare.add_argument("robots", metavar="ROBOT", nargs="*", help=robot)
    compare.add_argument("--all", action="store_true", help="every robot of example-robot-data")
    compare.add_argument("--samples", type=int, default=20, metavar="N", help="random states each (default: 20)")
    compare.add_argument("--no-timing", dest="timing", action="store_false", help="errors only")
    compare.add_argument("--json", action="store_true", help="print JSON")
    compare.set_defaults(run=_compare)

    add_simulate(commands, robot, print, _watched)
    add_check(commands, robot, print)
    return parser


def _watched() -> bool:
    """Whether a progress bar would be seen."""
    return sys.stderr.isatty() and importlib.util.find_spec("rich") is not None


# --- tables ----------------------------------------------------------------------------------------------


class _Column(NamedTuple):
    title: str
    number: bool = False


def _print_table(columns: Sequence[_Column], rows: Sequence[Sequence[str]], bad: Iterable[int] = ()) -> None:
    """An aligned table on stdout: numbers right, words left; the rows ``bad`` stand out where there is colour."""
    try:
        from rich.box import SIMPLE_HEAD
        from rich.console import Console
        from rich.table import Table
        from rich.text import Text
    except ImportError:
        _print_plain(columns, rows)
        return
    console = Console(file=sys.stdout, highlight=False)
    if not console.is_terminal:
        console = Console(file=sys.stdout, highlight=False, width=WIDE, color_system=None)
    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False, show_edge=False, header_style="bold")
    for column in columns:
        right = column.number
        table.add_column(column.title, justify="right" if right else "left", no_wrap=right, overflow="fold")
    marked = set(bad)
    for k, row in enumerate(rows):
        table.add_row(*(Text(cell) for cell in row), style="bold red" if k in marked else None)
    console.print(table)


def _print_plain(columns: Sequence[_Column], rows: Sequence[Sequence[str]]) -> None:
    lines = [[column.title for column in columns], *rows]
    widths = [max(len(line[k]) for line in lines) for k in range(len(columns))]
    lines.insert(1, ["-" * width for width in widths])
    for line in lines:
        cells = [
            cell.rjust(width) if column.number else cell.ljust(width)
            for cell, width, column in zip(line, widths, columns, strict=True)
        ]
        print("  ".join(cells).rstrip())


@contextmanager
def _progress(total: int) -> Iterator[Callable[[str], None]]:
    """A bar on stderr that is told what comes next; nothing without rich, without a terminal, or for one step."""
    try:
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
    except ImportError:
        yield lambda what: None
        return
    console = Console(stderr=True)
    parts = (TextColumn("{task.description:<32.32}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*parts, console=console, transient=True, disable=total < 2 or not console.is_terminal) as bar:
        task = bar.add_task("", total=total)
        done = -1

        def begin(what: str) -> None:
            nonlocal done
            done += 1
            bar.update(task, completed=done, description=what)

        yield begin


def _fold(text: str, first: str = "  ") -> None:
    """Print a text folded to the terminal, later lines under the text of the first."""
    import textwrap

    width = shutil.get_terminal_size((WIDE, 24)).columns if sys.stdout.isatty() else WIDE
    print(textwrap.fill(text, max(40, width), initial_indent=first, subsequent_indent=" " * len(first)))


# --- info ------------------------------------------------------------------------------------------------


def _info(arguments: argparse.Namespace) -> int:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # what it would say is among the notes
        model = load_urdf(arguments.robot, root=arguments.root)
    if arguments.json:
        print(json.dumps(_info_record(model), indent=2, ensure_ascii=False))
        return 0
    robot, options = model.robot, model.options
    at_root = {x.name: x.mass for x in robot.links}[robot.root]
    print(
        f"{model.name}: {options.root} root, {model.nv} freedoms (nq {model.nq}), {model.total_mass:.6g} kg that move\n"
    )
    print(f"links   {len(robot.links)}, root link {robot.root} of {at_root:.6g} kg")
    print(f"joints  {len(robot.joints)}: {_kinds(robot.joints)}")
    print(f"frames  {len(model.frames)}\n")
    columns = (_Column("link"), _Column("kg", True), _Column("joint"), _Column("kind"), _Column("v", True))
    _print_table((*columns, _Column("range", True)), list(_tree(model)))
    print("\nodd about the file:" if robot.notes else "\nnothing is odd about the file")
    for note in robot.notes:
        _fold(note, "  - ")
    return 0


def _kinds(joints: Iterable[Joint]) -> str:
    """How many joints of each kind, and how many mimic others."""
    joints = list(joints)
    count = Counter(joint.kind for joint in joints)
    mimics = sum(joint.mimic is not None for joint in joints)
    words = [f"{n} {kind}" for kind, n in count.most_common()] + [f"{mimics} of them mimics"] * bool(mimics)
    return ", ".join(words) or "none"


def _tree(model: Model) -> Iterator[list[str]]:
    """A row per link; the only child of a link stands right under it, several are set in."""
    robot = model.robot
    children, links = robot.children, {link.name: link for link in robot.links}
    places = {joint.name: joint for joint in model.joints[1:]}
    base = places.get("root_joint") if model.options.root == "floating" else None
    stack: list[tuple[str, Joint | None, str, str]] = [(robot.root, None, "", "")]
    while stack:
        name, joint, lead, below = stack.pop()
        if joint is None:
            of = ["", "", "", ""] if base is None else ["root_joint", "floating", _span(base.idx_v, 6), "unlimited"]
        else:
            place = places.get(joint.name)
            at = "" if place is None else _span(place.idx_v, place.nv)
            of = [joint.name, joint.kind + _axis(joint), at, _range(joint)]
        yield [lead + name, f"{links[name].mass:.4g}", *of]
        several = len(children[name]) > 1
        for k, child in enumerate(reversed(children[name])):
            branch, under = ("└ ", "  ") if k == 0 else ("├ ", "│ ")
            stack.append((child.child, child, below + branch * several, below + under * several))


def _span(first: int, count: int) -> str:
    return str(first) if count == 1 else f"{first}-{first + count - 1}"


def _axis(joint: Joint) -> str:
    """The axis if it is one of the coordinate axes, a star if not; nothing where a kind has none."""
    if joint.kind not in ("revolute", "continuous", "prismatic", "planar"):
        return ""
    for letter, column in zip("xyz", range(3), strict=True):
        if abs(joint.axis[column]) == 1.0:
            return f" {'-' if joint.axis[column] < 0.0 else ''}{letter}"
    return " *"


def _range(joint: Joint) -> str:
    if joint.kind == "fixed":
        return ""
    if math.isinf(joint.lower) and math.isinf(joint.upper):
        return "unlimited"
    unit = "m" if joint.kind == "prismatic" else "rad"
    return f"{joint.lower:.4g} .. {joint.upper:.4g} {unit:<3}"


def _info_record(model: Model) -> dict[str, Any]:
    """What ``info`` says, for machines; an absent limit is null."""
    robot = model.robot
    places = {joint.name: joint for joint in model.joints[1:]}
    return {
        "name": model.name,
        "root": model.options.root,
        "nq": model.nq,
        "nv": model.nv,
        "total_mass": model.total_mass,
        "gravity": model.gravity.tolist(),
        "frames": len(model.frames),
        "root_link": robot.root,
        "links": [{"name": link.name, "mass": link.mass, "com": list(link.com)} for link in robot.links],
        "joints": [
            {
                "name": joint.name,
                "kind": joint.kind,
                "parent": joint.parent,
                "child": joint.child,
                "axis": list(joint.axis),
                "lower": _finite(joint.lower),
                "upper": _finite(joint.upper),
                "velocity": _finite(joint.velocity),
                "effort": _finite(joint.effort),
                "mimic": None if joint.mimic is None else joint.mimic.leader,
                "idx_v": places[joint.name].idx_v if joint.name in places else None,
            }
            for joint in robot.joints
        ],
        "notes": list(robot.notes),
    }


def _finite(x: float | None) -> float | None:
    """A number that JSON can hold."""
    return x if x is not None and math.isfinite(x) else None


# --- derive ----------------------------------------------------------------------------------------------


def _derive(arguments: argparse.Namespace) -> int:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # ``info`` tells what is odd
        model = load_urdf(arguments.robot, root=arguments.root)
    asked = [name.strip() for name in arguments.quantity.split(",")]
    known = CALLS if arguments.program else QUANTITIES
    for name in asked:  # before the first of them takes its time
        if name not in known:
            raise SpatialDynError(f'quantity is "{name}", expected one of {", ".join(known)}')
    if arguments.program:
        return _derive_programs(model, asked, arguments)
    s = SymbolicManipulator(model, "symbols" if arguments.symbols else "numbers")
    comment = {"text": "", "latex": "% ", "c": "// ", "python": "# "}[arguments.format]
    for text in [*(f"{x} = {value}: {s.meaning[x]}" for x, value in s.parameters.items()), *s.assumptions]:
        # a name from a file may hold what ends a comment
        print(comment + "".join(c if c.isprintable() and c != "\\" else "?" for c in text))
    if s.parameters or s.assumptions:
        print()
    make = {"text": s.text, "latex": s.latex, "c": s.c_code, "python": s.python_code}[arguments.format]
    for name in asked:
        print(f"{name} = {make(name)}\n" if arguments.format == "latex" else make(name))
    return 0


def _derive_programs(model: Model, asked: Sequence[str], arguments: argparse.Namespace) -> int:
    if arguments.format not in ("c", "python") or arguments.symbols:
        raise SpatialDynError("--program prints c or python in numbers, expected --format c or python, no --symbols")
    for name in asked:
        k = specialize(model, dynamics.calls[CALLS[name]])
        print(k.c_code(name) if arguments.format == "c" else k.python_code(name))
    return 0


# --- compare ---------------------------------------------------------------------------------------------


class _Compared(NamedTuple):
    """A robot under the name it was asked for: its comparisons by root, or why neither library loads it."""

    label: str
    by_root: dict[str, Comparison]
    refused: str = ""

    @property
    def ok(self) -> bool:
        return all(comparison.ok for comparison in self.by_root.values())


def _compare(arguments: argparse.Namespace) -> int:
    pinocchio()
    if arguments.all == bool(arguments.robots):
        raise SpatialDynError("compare takes robots or --all, one of the two")
    if arguments.all and not example_robots():
        raise SpatialDynError('example-robot-data is not installed; pip install "spatialdyn[validate]"')
    examples = set(example_robots())
    sources = {name: name for name in arguments.robots}
    if arguments.all:
        sources = {name: str(path) for name, path in robot_names().items() if path in examples}
    found: list[_Compared] = []
    with _progress(len(sources)) as begin:
        for label, source in sources.items():
            begin(label)
            found.append(_compared(label, source, arguments))
    ok = all(robot.ok for robot in found)
    if arguments.json:
        print(json.dumps([_compare_record(robot) for robot in found], indent=2, ensure_ascii=False))
    elif len(found) == 1:
        _show_one(found[0])
    else:
        _show_many(found, arguments.timing)
    return 0 if ok else 1


def _compared(label: str, source: str, arguments: argparse.Namespace) -> _Compared:
    """Both roots of a robot. Under ``--all`` a robot that Pinocchio refuses too is no failure."""
    try:
        return _Compared(
            label,
            {
                root: compare_with_pinocchio(source, root, samples=arguments.samples, timing=arguments.timing)
                for root in ROOTS
            },
        )
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
    columns = [_Column("call"), *(_Column(f"{root} ", True) for root in ROOTS)]
    columns += [_Column(title, True) for title in ("ours µs", "pin µs", "ratio")] * timing
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
    _fold(f"{robot.label}: {sizes}; {samples} random states; error = max |x - x_pin| / max(1, max |x_pin|)", "")
    print()
    _print_table(columns, lines, bad)
    print()
    if timing:
        print(f"times: single calls from Python, {timed_root} root")
    _show_notes([robot])
    print(_verdict([robot]))


def _show_many(robots: Sequence[_Compared], timing: bool) -> None:
    """A row per robot: its largest error for each root, the worst call of all, and how the times compare."""
    columns = [_Column("robot"), _Column("nv", True), *(_Column(f"{root} ", True) for root in ROOTS)]
    columns += [_Column("worst call")] + [_Column(call, True) for call in TIMED] * timing
    lines, bad = [], []
    for k, robot in enumerate(robots):
        if robot.refused:
            lines.append([robot.label, "", "", "", "refused by both", *[""] * len(TIMED) * timing])
            continue
        line = [robot.label, str(robot.by_root["fixed"].nv)]
        worst = [robot.by_root[root].worst for root in ROOTS]
        line += [*map(_error, worst), max(worst, key=lambda row: row.badness).call]
        if timing:
            timed = robot.by_root["fixed" if robot.by_root["fixed"].nv else "floating"]
            line += [_time(_rows(timed)[call].ratio) for call in TIMED]
        lines.append(line)
        if not robot.ok:
            bad.append(k)
    _print_table(columns, lines, bad)
    print()
    if timing:
        _fold("rnea, crba, aba: our time over Pinocchio's, single calls from Python, fixed root unless nv is 0", "")
    _show_notes(robots)
    print(_verdict(robots))


def _show_notes(robots: Sequence[_Compared]) -> None:
    """Every note once, with the calls, roots and robots it is about."""
    notes: dict[str, dict[str, list[str]]] = {}
    for robot in robots:
        if robot.refused:
            notes.setdefault(f"neither library loads it: {robot.refused}", {}).setdefault(robot.label, [])
        for root, comparison in robot.by_root.items():
            for row in comparison.rows:
                if row.note:
                    who = f"{root} root" if len(robots) == 1 else f"{robot.label} ({root})"
                    notes.setdefault(row.note, {}).setdefault(who, []).append(row.call)
    for note, about in notes.items():
        calls = ", ".join(dict.fromkeys(call for some in about.values() for call in some))
        _fold(f"{', '.join(about)}{': ' * bool(calls)}{calls}: {note}", "* ")


def _verdict(robots: Sequence[_Compared]) -> str:
    """One line: does everything agree, and if not, what does not."""
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
    who = compared[0].label if len(compared) == 1 else f"{len(compared)} robots"
    refused = len(robots) - len(compared)
    rest = f"; {refused} refused by both" if refused else ""
    return f"AGREES with Pinocchio: {who}, every call within its bound{rest}"


def _compare_record(robot: _Compared) -> dict[str, Any]:
    """What ``compare`` says of a robot, for machines; a number that is not finite is null."""
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
                        "error": _finite(row.error),
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
