"""``spatialdyn simulate ROBOT``: a free motion of a robot, and the change of its energy."""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Callable

import numpy as np

from ..calls.dynamics import calls
from ..calls.prepare import compile_calls
from ..calls.states import random_configuration
from ..errors import SimulationInterrupt, SpatialDynError
from ..model.model import Model
from ..pictures.scene import view
from ..pictures.stage import viser_module
from ..simulation import Trajectory, integrators, simulate
from ..simulation.energy import scale_of
from .printing import shown
from .robots import add_quiet, add_robot, load, parse_numbers
from .targets import check_file, check_plot, check_report
from .view import PAGES, keep_open, notes

LARGE = 0.1  # of its scale: a larger change of energy gives a warning


def add(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments to its parser."""
    add_robot(parser)
    parser.add_argument("--duration", type=float, default=10.0, metavar="S", help="seconds (default: 10)")
    parser.add_argument("--dt", type=float, default=1e-3, metavar="S", help="step in seconds (default: 0.001)")
    parser.add_argument("--method", choices=list(integrators), default="rk4", metavar="METHOD", help=_methods())
    parser.add_argument(
        "--q0", metavar="Q", help="joint positions, separated by commas (default: random, always the same)"
    )
    parser.add_argument("--v0", metavar="V", help="joint velocities, separated by commas (default: zeros)")
    parser.add_argument(
        "--record", type=int, metavar="K", help="record every K-th step (default: 10 000 samples at most)"
    )
    parser.add_argument("--plot", metavar="FILE", help="draw q, v and energy to a PNG, SVG, PDF, JPG or WebP file")
    parser.add_argument("--report", metavar="FILE", help="write one HTML page of it all, which needs no network")
    parser.add_argument("--save", metavar="FILE", help="write the trajectory to an npz file, or a page of it (.html)")
    parser.add_argument("--view", action="store_true", help="play the motion in the browser")
    add_quiet(parser)
    parser.set_defaults(run=_run)


def _methods() -> str:
    return f"one of {', '.join(integrators)} (default: rk4)"


def _run(arguments: argparse.Namespace) -> int:
    check_plot(arguments.plot)
    page = arguments.save is not None and arguments.save.lower().endswith(PAGES)
    check_report(arguments.report)
    check_file("--save", arguments.save)
    if page or arguments.view:
        viser_module()  # raises before the simulation where it is missing
    with shown("reading", "robots", arguments.quiet):
        model = load(arguments)
        compile_calls(model, ("kinetic_energy", "potential_energy"))  # else Ctrl-C has to wait for them
    q0 = parse_numbers("--q0", arguments.q0, model.nq)
    if q0 is None:
        q0 = random_configuration(model, np.random.default_rng(0))
    v0 = parse_numbers("--v0", arguments.v0, model.nv)
    stopped = None
    with warnings.catch_warnings(record=True) as caught, shown("simulating", "steps", arguments.quiet) as report:
        warnings.simplefilter("always")
        try:
            run = simulate(
                model, q0, np.zeros(model.nv) if v0 is None else v0, arguments.duration, arguments.dt,
                arguments.method, record=arguments.record, progress=report,
            )  # fmt: skip
        except SimulationInterrupt as interrupt:
            run, stopped = interrupt.trajectory, interrupt
    for line in _report(model, run):
        print(line)
    for warning in caught:
        print(f"note    {warning.message}")
    if arguments.save:
        if page:
            with notes():
                scene = view(run)
            scene.save(arguments.save)
        else:
            _write("--save", arguments.save, run.save)
        print(f"saved   {arguments.save}")
    if arguments.plot:
        _write("--plot", arguments.plot, lambda path: run.plot(path=path))
        print(f"drawn   {arguments.plot}")
    if arguments.report:
        run.report(arguments.report)
        print(f"written {arguments.report}")
    if arguments.view and stopped is None:
        with notes():
            scene = view(run)
        keep_open(scene)
    if stopped is not None:
        raise stopped  # ``main`` reports it in one line
    return 0


def _write(option: str, path: str, write: Callable[[str], None]) -> None:
    """Write a file. Raises SpatialDynError if the system refuses."""
    try:
        write(path)
    except OSError as error:
        raise SpatialDynError(f"{option} is {path!r}: {error.strerror}, expected a file that can be written") from None


def _report(model: Model, run: Trajectory) -> list[str]:
    """The report of a run, in a few lines."""
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
