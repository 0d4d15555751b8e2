"""``spatialdyn requires ROBOT``: which parts of a scene a motion needs, and the cheapest scene that keeps it."""

from __future__ import annotations

import argparse
import warnings

import numpy as np

from ..accuracy.requirement import COLUMNS, Requirement
from ..accuracy.requires import SAMPLES, SPREAD, requires
from ..accuracy.scene_parts import KINDS, PARTS
from ..simulation.scene import Scene
from .printing import Column, fold, print_table, shown
from .robots import add_quiet, add_robot, load, parse_numbers, text_of
from .simulate import start_of
from .targets import check_plot


def add(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments to its parser."""
    add_robot(parser)
    parser.add_argument("--tolerance", type=float, default=1e-3, metavar="E", help="of q or v (default: 0.001)")
    parser.add_argument("--duration", type=float, default=1.0, metavar="S", help="of the motion (default: 1 s)")
    parser.add_argument("--scene", metavar="FILE", help="what acts: a TOML file (default: all that the URDF declares)")
    parser.add_argument("--q0", metavar="Q", help="joint positions (default: in the middle of the limits)")
    parser.add_argument("--v0", metavar="V", help="joint velocities, separated by commas (default: zeros)")
    parser.add_argument("--torque", metavar="T", help="joint torques, separated by commas (default: zeros)")
    parser.add_argument("--observe", choices=("q", "v"), default="q", help="what is to be kept (default: q)")
    parser.add_argument("--samples", type=int, default=SAMPLES, metavar="N", help=f"of motions (default: {SAMPLES})")
    parser.add_argument("--spread", type=float, default=SPREAD, metavar="X", help=f"of starts (default: {SPREAD:g})")
    parser.add_argument(
        "--kinds", metavar="NAMES", help=f"some of {', '.join((*KINDS, *PARTS))} (default: the first five)"
    )
    parser.add_argument("--plot", metavar="FILE", help="draw change against cost to a PNG, SVG, PDF, JPG or WebP file")
    parser.add_argument("--json", action="store_true", help="print JSON")
    add_quiet(parser)
    parser.set_defaults(run=_run, seed=None)


def _run(arguments: argparse.Namespace) -> int:
    check_plot(arguments.plot)
    text = None if arguments.scene is None else text_of("--scene", arguments.scene)
    kinds = KINDS if arguments.kinds is None else arguments.kinds.split(",")
    with warnings.catch_warnings(), shown("measuring", "parts", arguments.quiet) as report:
        warnings.simplefilter("ignore")
        model = load(arguments, mimic=text is None or "[[constraint]]" not in text)
        scene = Scene.of(model) if text is None else Scene.from_toml(model, text)
        v0 = parse_numbers("--v0", arguments.v0, model.nv)
        found = requires(
            scene, start_of(model, scene.constraints, arguments), np.zeros(model.nv) if v0 is None else v0,
            arguments.duration, arguments.tolerance, parse_numbers("--torque", arguments.torque, model.nv),
            observe=arguments.observe, samples=arguments.samples, spread=arguments.spread, spread_v=arguments.spread,
            kinds=kinds, progress=report,
        )  # fmt: skip
    if arguments.json:
        print(found.to_json())
    else:
        _show(found)
    if arguments.plot:
        found.plot(arguments.plot)
        if not arguments.json:
            print(f"drawn   {arguments.plot}")
    return 0


def _show(found: Requirement) -> None:
    """The table of parts, and the conclusion."""
    fold(found.head, first="")
    columns = [Column(name, name in COLUMNS[2:5]) for name in COLUMNS]
    bad = [k for k, x in enumerate(found.rows) if x.verdict in ("needed", "cannot")]
    print_table(columns, found.table(), bad)
    fold(found.foot, first="")
    print()
    print(found.code)
