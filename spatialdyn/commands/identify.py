"""``spatialdyn identify ROBOT LOG.csv``: parameters of a robot from a log of positions and torques."""

from __future__ import annotations

import argparse
import warnings
from typing import Any

from ..calls.json_numbers import finite_or_none, json_text
from ..identification.base import ROWS
from ..identification.equations import FORMS, HOLDS
from ..identification.identified import COLUMNS, Identified, Validation
from ..identification.identify import METHODS, identify
from ..identification.recording import Recording
from ..identification.unknowns import DEFAULT, WORDS
from ..sources.to_urdf import to_urdf
from .printing import Column, fold, print_table
from .robots import add_robot, load
from .targets import check_file, check_report


def add(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments to its parser."""
    add_robot(parser)
    parser.add_argument(
        "log", metavar="LOG", help="CSV or parquet: t, q0 ... or q_JOINT ..., tau0 ..., perhaps v0 ..., a0 ..."
    )
    parser.add_argument("--lock", metavar="NAMES", help="joints that do not move, separated by commas")
    parser.add_argument("--method", choices=METHODS, default="log_cholesky", help="default: log_cholesky")
    parser.add_argument(
        "--parameters", default="+".join(DEFAULT), metavar="WORDS",
        help=f"some of {', '.join(WORDS)}, joined by + (default: {'+'.join(DEFAULT)})",
    )  # fmt: skip
    parser.add_argument("--form", choices=FORMS, help="equations of torques, or of momenta without accelerations")
    parser.add_argument("--hold", choices=HOLDS, help="torques act until the next sample, or up to their own")
    parser.add_argument("--delay", metavar="S", help="seconds by which the motion follows the torque, or fit")
    parser.add_argument("--window", type=int, default=1, metavar="N", help="rows that are averaged (default: 1)")
    parser.add_argument("--cutoff", type=float, metavar="HZ", help="of a filter for positions (default: none)")
    parser.add_argument("--v-min", type=float, default=0.0, metavar="V", help="slower rows are left out (default: 0)")
    parser.add_argument("--prior", type=float, metavar="W", help="weight of the robot's own inertias (default: 1)")
    parser.add_argument("--rows", choices=ROWS, default="all", help="all, or the six of a floating base (default: all)")
    parser.add_argument("--payload", metavar="FRAME", help="find the load on a frame, the robot being known")
    parser.add_argument("--resample", action="store_true", help="put uneven times of the logs on an even grid")
    parser.add_argument("--validate", metavar="LOG", help="a log of another motion, to be predicted")
    parser.add_argument("--report", metavar="FILE", help="write one HTML page of it all, which needs no network")
    parser.add_argument("--save", metavar="FILE", help="write the robot to a .urdf file")
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> int:
    check_report(arguments.report)
    check_file("--save", arguments.save, (".urdf",))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model = load(arguments, mimic=True)
        if arguments.lock:
            model = model.reduced(arguments.lock.split(","))
        log = Recording.load(arguments.log, model, resample=arguments.resample)
        again = arguments.validate
        other = None if again is None else Recording.load(again, model, resample=arguments.resample)
        found = identify(
            log, model, arguments.method, arguments.parameters, arguments.prior, form=arguments.form,
            hold=arguments.hold, delay=_delay(arguments.delay), window=arguments.window, cutoff=arguments.cutoff,
            v_min=arguments.v_min, payload=arguments.payload, rows=arguments.rows,
        )  # fmt: skip
        judged = None if other is None else found.validate(other)
        odd = () if other is None else other.check(model)
    if arguments.json:
        more = {} if judged is None else {"validation": {**_numbers(judged), "notes": list(odd)}}
        print(json_text({**found.to_dict(), **more}))
    else:
        _show(found)
    if judged is not None and not arguments.json:
        fold("another motion: rms of the torque " + ", ".join(f"{x:.3g}" for x in judged.ratio) + " times the noise")
        for note in odd:
            fold(f"note    another motion: {note}", first="")
    if arguments.report:  # first, since URDF may not hold the robot found
        found.report(arguments.report, other)
    if arguments.save:
        text = to_urdf(found.model())
        with open(arguments.save, "w", encoding="utf-8") as file:
            file.write(text)
    if not arguments.json:
        for word, path in (("saved  ", arguments.save), ("written", arguments.report)):
            if path:
                print(f"{word} {path}")
    return 0


def _delay(text: str | None) -> Any:
    """Seconds, True for "fit", anything else as it is: ``identify`` refuses it."""
    if text is None or text == "fit":
        return text == "fit"
    try:
        return float(text)
    except ValueError:
        return text


def _numbers(judged: Validation) -> dict[str, list[float | None]]:
    """The figures of a Validation for each freedom; None if not finite."""
    arrays = {name: getattr(judged, name).tolist() for name in ("rms", "noise", "ratio", "share", "white")}
    return {name: [finite_or_none(x) for x in values] for name, values in arrays.items()}


def _show(found: Identified) -> None:
    """The table of base parameters, and the oddities."""
    fold(found.head, first="")
    columns = [Column(name, k > 0) for k, name in enumerate(COLUMNS)]
    bad = [k for k, label in enumerate(found.base.labels) if label in found.poor]
    print_table(columns, found.table(), bad)
    if any(" + " in label for label in found.base.labels):
        fold(
            "name + n is a sum of n + 1 parameters, as torques depend on that alone; --report writes the sums", first=""
        )
    fold("noise of each freedom: " + ", ".join(f"{x:.3g}" for x in found.noise), first="")
    for note in found.notes:
        fold(f"note    {note}", first="")
