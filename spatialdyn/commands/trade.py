"""``spatialdyn trade ROBOT``: error and cost of the options for a task, and the cheapest within a tolerance."""

from __future__ import annotations

import argparse
import math
import warnings

from ..accuracy.call_errors import WHEN_NAMED
from ..accuracy.references import NORMS
from ..accuracy.results import EACH_JOINT, Option, Tradeoff, figure
from ..accuracy.tradeoff import BATCH, TASKS, advice, trade
from ..calls.json_numbers import json_text
from ..errors import SpatialDynError, literal
from ..simulation import integrators
from .printing import Column, fold, print_table, shown
from .robots import add_quiet, add_robot, load
from .targets import check_plot, check_report


def add(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments to its parser."""
    add_robot(parser)
    parser.add_argument("--task", choices=TASKS, default=TASKS[0], metavar="TASK", help=f"one of {', '.join(TASKS)}")
    parser.add_argument("--tolerance", type=float, metavar="E", help="name the cheapest option within this error")
    parser.add_argument(
        "--norm", choices=NORMS, default=NORMS[0], help="each: of every joint relative to its own scale"
    )
    parser.add_argument("--states", type=int, metavar="N", help="random states in which errors are measured")
    parser.add_argument("--batch", type=int, default=BATCH, metavar="N", help=f"samples a call (default: {BATCH})")
    parser.add_argument("--duration", type=float, default=1.0, metavar="S", help="of simulations (default: 1 s)")
    parser.add_argument(
        "--methods",
        metavar="NAMES",
        help=f"some of the task's calls (default: all but {', '.join(WHEN_NAMED)}), or of {', '.join(integrators)}",
    )
    parser.add_argument("--plot", metavar="FILE", help="draw error against cost to a PNG, SVG, PDF, JPG or WebP file")
    parser.add_argument("--report", metavar="FILE", help="write one HTML page of it all, which needs no network")
    parser.add_argument("--json", action="store_true", help="print JSON")
    add_quiet(parser)
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> int:
    tolerance = arguments.tolerance
    if tolerance is not None and not tolerance > 0.0:
        raise SpatialDynError(f"--tolerance is {literal(tolerance)}, expected a number above 0")
    check_plot(arguments.plot)
    check_report(arguments.report)
    methods = None if arguments.methods is None else arguments.methods.split(",")
    with warnings.catch_warnings(), shown("measuring", "options", arguments.quiet) as report:
        warnings.simplefilter("ignore")
        model = load(arguments, mimic=True)
        found = trade(model, arguments.task, arguments.states, arguments.batch, arguments.duration, methods, report)
        chosen = None if tolerance is None else advice(found, tolerance, arguments.norm)
    if arguments.json:
        added = {} if chosen is None else {"recommended": {"name": chosen.option.name, "why": chosen.why}}
        print(json_text({**found.to_dict(), **added}))
    else:
        _show(found, chosen.option if chosen else None)
        if chosen is not None:
            print()
            fold(f"{chosen.code}", first="take    ")
            fold(chosen.why, first="why     ")
    if arguments.plot:
        found.plot(arguments.plot)
        if not arguments.json:
            print(f"drawn   {arguments.plot}")
    if arguments.report:
        found.report(arguments.report)
        if not arguments.json:
            print(f"written {arguments.report}")
    return 0


def _show(found: Tradeoff, chosen: Option | None) -> None:
    """The table of options, and the reasons of those that failed."""
    fold(found.head, first="")
    columns = [Column(""), Column("option"), Column("error", True), Column("bound", True)]
    columns += [Column("worst joint", True), Column(found.unit, True)]
    rows = [
        [
            ">" if chosen is not None and x.name == chosen.name else "*" if x.best else "",
            x.name, figure(x.error), figure(x.bound), figure(x.each), f"{x.ns:.4g}",
        ]
        for x in found.options
    ]  # fmt: skip
    bad = [k for k, x in enumerate(found.options) if not math.isfinite(x.error)]
    print_table(columns, rows, bad)
    print("*       nothing cheaper has a smaller error")
    fold(EACH_JOINT, first="")
    for x in found.options:
        if x.note:
            fold(f"{x.name}: {x.note}", first="note    ")
