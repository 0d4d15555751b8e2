"""``spatialdyn excite ROBOT``: a path that moves every base parameter, within the limits of the joints."""

from __future__ import annotations

import argparse
import warnings

import numpy as np

from ..errors import SpatialDynError
from ..identification.excitation import CRITERIA, excitation
from ..identification.unknowns import DEFAULT
from .robots import add_robot, load, parse_numbers
from .targets import check_file, check_plot


def add(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments to its parser."""
    add_robot(parser)
    parser.add_argument("--lock", metavar="NAMES", help="joints that do not move, separated by commas")
    parser.add_argument("--duration", type=float, default=10.0, metavar="S", help="of one period (default: 10 s)")
    parser.add_argument("--harmonics", type=int, default=5, metavar="N", help="of the Fourier series (default: 5)")
    parser.add_argument("--criterion", choices=CRITERIA, default="logdet", help="default: logdet")
    parser.add_argument("--parameters", default="+".join(DEFAULT), metavar="WORDS", help="as of `spatialdyn identify`")
    parser.add_argument("--payload", metavar="FRAME", help="excite the load on a frame, the robot being known")
    parser.add_argument("--centre", metavar="Q", help="mean positions (default: in the middle of the limits)")
    parser.add_argument("--acceleration", type=float, metavar="A", help="largest one (default: none)")
    parser.add_argument("--rate", type=float, default=100.0, metavar="HZ", help="of the samples (default: 100)")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of the random paths (default: 0)")
    parser.add_argument("--save", metavar="FILE", help="write t, q, v and a to a .csv file")
    parser.add_argument("--plot", metavar="FILE", help="draw q, v and a to a PNG, SVG, PDF, JPG or WebP file")
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> int:
    check_file("--save", arguments.save, (".csv",))
    check_plot(arguments.plot)
    if not 0.0 < arguments.rate < 1e6:
        raise SpatialDynError(f"--rate is {arguments.rate:g}, expected a number above 0, up to 1e6")
    slow = 2.0 * arguments.harmonics / arguments.duration if arguments.duration > 0.0 else 0.0
    if arguments.rate < slow:
        raise SpatialDynError(
            f"--rate is {arguments.rate:g}, expected {slow:g} or more, twice the highest harmonic of the path"
        )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model = load(arguments, mimic=True)
        if arguments.lock:
            model = model.reduced(arguments.lock.split(","))
    path = excitation(
        model, arguments.duration, arguments.harmonics, arguments.criterion, arguments.parameters,
        centre=parse_numbers("--centre", arguments.centre, model.nq), acceleration=arguments.acceleration,
        payload=arguments.payload, seed=arguments.seed,
    )  # fmt: skip
    peaks = path.peaks()
    print(f"{model.name}: {path.duration:g} s, speeds up to {np.array2string(peaks.v, precision=3)}")
    if arguments.save:
        t = np.arange(round(path.duration * arguments.rate) + 1) / arguments.rate
        rows = np.column_stack([t, *path(t)])
        names = ["t", *(f"q{k}" for k in range(model.nq)), *(f"{x}{k}" for x in "va" for k in range(model.nv))]
        np.savetxt(arguments.save, rows, "%.17g", ",", header=",".join(names), comments="")
        print(f"saved   {arguments.save}")
    if arguments.plot:
        path.plot(arguments.plot)
        print(f"drawn   {arguments.plot}")
    return 0
