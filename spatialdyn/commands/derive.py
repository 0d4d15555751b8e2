"""``spatialdyn derive ROBOT``: M, C, g, energies in closed form, or code of a program for any size of robot."""

from __future__ import annotations

import argparse
from collections.abc import Sequence

from ..calls import dynamics
from ..calls.specialize import specialize
from ..errors import SpatialDynError
from ..lagrangian.size import fourier_terms
from ..lagrangian.symbolic_manipulator import LONGEST, QUANTITIES, SymbolicManipulator
from ..model.model import Model
from .printing import shown
from .robots import add_quiet, add_robot, load

PRODUCTS = 12  # of terms, for each Fourier term of M: 5 to 47 for arms of 3 to 6 joints, 12 in the median
PROGRAM_CALLS = {  # calls whose programs --program prints, by the names of QUANTITIES
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


def add(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments to its parser."""
    add_robot(parser)
    parser.add_argument(
        "--quantity", default="M,C,g", metavar="LIST", help=f"of {', '.join(QUANTITIES)} (default: M,C,g)"
    )
    parser.add_argument("--format", choices=("text", "latex", "c", "python"), default="text", help="default: text")
    parser.add_argument("--symbols", action="store_true", help="masses, lengths, ... as symbols, not numbers")
    parser.add_argument(
        "--program",
        action="store_true",
        help="c or python of the recursion's program, unsimplified, in the robot's numbers, for any size of robot",
    )
    parser.add_argument(
        "--limit", type=int, default=LONGEST, metavar="N",
        help=f"most products of terms for a quantity, 0 for no limit (default: {LONGEST})",
    )  # fmt: skip
    add_quiet(parser)
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> int:
    with shown("reading", "robots", arguments.quiet):
        model = load(arguments)
    asked = [name.strip() for name in arguments.quantity.split(",")]
    known = PROGRAM_CALLS if arguments.program else QUANTITIES
    for name in asked:  # all errors before the first long derivation
        if name not in known:
            raise SpatialDynError(f'quantity is "{name}", expected one of {", ".join(known)}')
    if arguments.program:
        return _print_programs(model, asked, arguments)
    limit = arguments.limit or None
    with shown("reading", "robots", arguments.quiet):
        if limit is not None and model.mimic_matrix is None:
            for name in asked:
                _check_size(model, name, limit)
        s = SymbolicManipulator(model, "symbols" if arguments.symbols else "numbers", limit)
    comment = {"text": "", "latex": "% ", "c": "// ", "python": "# "}[arguments.format]
    for text in [*(f"{x} = {value}: {s.meaning[x]}" for x, value in s.parameters.items()), *s.assumptions]:
        # a name from a file may contain characters that end a comment
        print(comment + "".join(c if c.isprintable() and c != "\\" else "?" for c in text))
    if s.parameters or s.assumptions:
        print()
    make = {"text": s.text, "latex": s.latex, "c": s.c_code, "python": s.python_code}[arguments.format]
    for k, name in enumerate(asked):
        with shown("deriving", f"quantities, {name}", arguments.quiet) as report:
            report(k, len(asked))
            text = make(name)
        print(f"{name} = {text}\n" if arguments.format == "latex" else text)
    return 0


def _check_size(model: Model, quantity: str, limit: int) -> None:
    """Raise SpatialDynError at once if a closed form is expected to need more products of terms than the limit."""
    terms = fourier_terms(model, quantity)
    if PRODUCTS * terms > limit:
        raise SpatialDynError(
            f'{quantity} of model "{model.name}" has some {terms} terms in closed form, which take some '
            f"{PRODUCTS * terms} products, expected {limit} at most; --limit 0 computes it, and --program --format c "
            "prints code for any robot"
        )


def _print_programs(model: Model, asked: Sequence[str], arguments: argparse.Namespace) -> int:
    if arguments.format not in ("c", "python") or arguments.symbols:
        raise SpatialDynError("--program prints c or python in numbers, expected --format c or python, no --symbols")
    for done, name in enumerate(asked):
        with shown("writing", f"programs, {name}", arguments.quiet) as report:
            report(done, len(asked))
            k = specialize(model, dynamics.calls[PROGRAM_CALLS[name]])
            text = k.c_code(name) if arguments.format == "c" else k.python_code(name)
        print(text)
    return 0
