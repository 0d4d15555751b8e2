"""``spatialdyn simulate ROBOT``: let a robot move freely, and see what becomes of its energy."""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..calls.dynamics import calls
from ..calls.states import random_configuration
from ..errors import SimulationInterrupt, SpatialDynError
from ..model.model import Model
from ..simulation import Trajectory, integrators, simulate
from ..simulation.energy import scale_of
from .printing import watched
from .robots import add_robot, load
from .targets import check_file, check_plot

Array = NDArray[np.float64]
LARGE = 0.1  # of its scale, beyond which a change of energy is warned of


def add(commands: Any) -> None:
    """Register the command with what argparse's ``add_subparsers`` has given."""
    parser = commands.add_parser("simulate", help="free motion of a robot, its energy, a plot and a file of it")
    add_robot(parser)
    parser.add_argument("--duration", type=float, default=10.0, metavar="S", help="seconds (default: 10)")
    parser.add_argument("--dt", type=float, default=1e-3, metavar="S", help="step in seconds (default: 0.001)")
    parser.add_argument("--method", choices=list(integrators), default="rk4", metavar="METHOD", help=_methods())
    parser.add_argument(
        "--q0", metavar="Q", help="joint positions, separated by commas (default: random, always the same)"
    )
    parser.add_argument("--v0", metavar="V", help="joint velocities, separated by commas (default: zeros)")
    parser.add_argument(
        "--record", type=int, metavar="K", help="keep every K-th step (default: 10 000 samples at most)"
    )
    parser.add_argument("--plot", metavar="FILE", help="draw q, v and energy to a PNG, SVG or PDF file")
    parser.add_argument("--save", metavar="FILE", help="write the trajectory to an npz file")
    parser.set_defaults(run=_run)


def _methods() -> str:
    return f"one of {', '.join(integrators)} (default: rk4)"


def _run(arguments: argparse.Namespace) -> int:
    check_plot(arguments.plot)
    check_file("--save", arguments.save)
    model = load(arguments)
    q0 = _numbers("--q0", arguments.q0, model.nq)
    if q0 is None:
        q0 = random_configuration(model, np.random.default_rng(0))
    v0 = _numbers("--v0", arguments.v0, model.nv)
    stopped = None
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            run = simulate(
                model, q0, np.zeros(model.nv) if v0 is None else v0, arguments.duration, arguments.dt,
                arguments.method, record=arguments.record, progress=watched(),
            )  # fmt: skip
        except SimulationInterrupt as interrupt:
            run, stopped = interrupt.trajectory, interrupt
    for line in _report(model, run):
        print(line)
    for warning in caught:
        print(f"note    {warning.message}")
    if arguments.save:
        _write("--save", arguments.save, run.save)
        print(f"saved   {arguments.save}")
    if arguments.plot:
        _write("--plot", arguments.plot, run.plot().savefig)
        print(f"drawn   {arguments.plot}")
    if stopped is not None:
        raise stopped  # which the command line says in one line
    return 0


def _write(option: str, path: str, write: Callable[[str], None]) -> None:
    """Write a file. Raises SpatialDynError where the system does not let it."""
    try:
        write(path)
    except OSError as error:
        raise SpatialDynError(f"{option} is {path!r}: {error.strerror}, expected a file that can be written") from None


def _numbers(option: str, text: str | None, count: int) -> Array | None:
    """Numbers separated by commas. Raises SpatialDynError unless there are ``count``."""
    if text is None:
        return None
    try:
        x = np.array([float(part) for part in text.split(",")])
    except ValueError:
        raise SpatialDynError(f"{option} is {text!r}, expected numbers separated by commas") from None
    if len(x) != count:
        raise SpatialDynError(f"{option} has {len(x)} numbers, expected {count}")
    return x


def _report(model: Model, run: Trajectory) -> list[str]:
    """What there is to say of a run in a few lines."""
    method = integrators[run.method]
    change = run.energy - run.energy[0]
    T = calls["kinetic_energy"](model, run.q, run.v)
    far, scale = float(abs(change).max()), float(scale_of(T, run.energy - T)[-1])
    lines = [
        f"{model.name}: {len(run)} samples of {run.t[-1]:g} s by {run.method}, dt {run.dt:g} s",
        f"method  order {method.order}, preserves {method.preserves}; {method.note}",
        f"energy  {run.energy[0]:.9g} J, changes by {change[-1]:.3g} J, at most {far:.3g} J, {_share(far, scale)} of "
        f"its scale; kinetic at most {T.max():.4g} J",
        f"q(end)  {np.array2string(run.q[-1], precision=6, max_line_width=10_000)}",
    ]
    if not far <= LARGE * scale:
        cure = "rtol and atol" if method.family is None else "dt"
        lines.append(
            f"warning energy changes by {_share(far, scale)} of its scale though nothing drives the robot, expected at "
            f"most {LARGE:.0%}: the motion is not to be trusted; reduce {cure}"
        )
    return lines


def _share(part: float, whole: float) -> str:
    return f"{100.0 * part / whole:.2g} %" if whole > 0.0 else "0 %" if part == 0.0 else "all"
