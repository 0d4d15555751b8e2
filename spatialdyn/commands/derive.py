"""``spatialdyn derive ROBOT``: its M, C, g, energies in closed form, or a program of any size of robot."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import Any

from ..calls import dynamics
from ..calls.specialize import specialize
from ..errors import SpatialDynError
from ..lagrangian.symbolic_manipulator import QUANTITIES, SymbolicManipulator
from ..model.model import Model
from .robots import add_robot, load

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


def add(commands: Any) -> None:
    """Register the command with what argparse's ``add_subparsers`` has given."""
    parser = commands.add_parser("derive", help="M, C, g, energies in closed form")
    add_robot(parser)
    parser.add_argument(
        "--quantity", default="M,C,g", metavar="LIST", help=f"of {', '.join(QUANTITIES)} (default: M,C,g)"
    )
    parser.add_argument("--format", choices=("text", "latex", "c", "python"), default="text", help="default: text")
    parser.add_argument("--symbols", action="store_true", help="masses, lengths, ... as symbols, not numbers")
    parser.add_argument(
        "--program",
        action="store_true",
        help="of any size of robot: c or python straight from the recursion, unsimplified, in the robot's numbers",
    )
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> int:
    model = load(arguments)
    asked = [name.strip() for name in arguments.quantity.split(",")]
    known = CALLS if arguments.program else QUANTITIES
    for name in asked:  # before the first of them takes its time
        if name not in known:
            raise SpatialDynError(f'quantity is "{name}", expected one of {", ".join(known)}')
    if arguments.program:
        return _print_programs(model, asked, arguments)
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


def _print_programs(model: Model, asked: Sequence[str], arguments: argparse.Namespace) -> int:
    if arguments.format not in ("c", "python") or arguments.symbols:
        raise SpatialDynError("--program prints c or python in numbers, expected --format c or python, no --symbols")
    for name in asked:
        k = specialize(model, dynamics.calls[CALLS[name]])
        print(k.c_code(name) if arguments.format == "c" else k.python_code(name))
    return 0
