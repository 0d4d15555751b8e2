"""``spatialdyn simulate ROBOT``: motion of a robot without motor torques, and the balance of its energy."""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Callable
from dataclasses import fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..actuation.friction import Friction
from ..calls.dynamics import calls
from ..calls.files import check_ending
from ..calls.prepare import compile_calls
from ..calls.random_configurations import random_configuration
from ..constraints.loops import close_loops
from ..constraints.table import Constraints
from ..errors import SimulationInterrupt, SpatialDynError, literal
from ..model.model import Model
from ..monitors.ledger import EnergyLedger, energy_ledger
from ..pictures.markup import PAGE_FILES
from ..pictures.stage import viser_module
from ..pictures.view import view
from ..simulation import Trajectory, integrators, simulate
from ..simulation.effects.friction import STEPPED, WAYS
from ..simulation.recorder import scale_of
from ..simulation.scene import Scene
from ..sources.declared_scene import couplers_of
from ..sources.run_files import ARRAY_FILES
from .printing import shown
from .robots import add_quiet, add_robot, load, parse_numbers, text_of
from .targets import check_file, check_plot, check_report
from .view import keep_open, notes

Array = NDArray[np.float64]
LARGE = 0.1  # of the energy's scale: a larger change of energy gives a warning


def add(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments to its parser."""
    add_robot(parser)
    parser.add_argument("--duration", type=float, default=10.0, metavar="S", help="seconds (default: 10)")
    parser.add_argument("--dt", type=float, default=1e-3, metavar="S", help="step in seconds (default: 0.001)")
    parser.add_argument("--method", choices=list(integrators), metavar="METHOD", help=_methods())
    parser.add_argument(
        "--q0", metavar="Q",
        help="joint positions, separated by commas (default: in the middle of the limits; with --constraints, closed)",
    )  # fmt: skip
    parser.add_argument("--seed", type=int, metavar="N", help="start at random joint positions, the N-th such ones")
    parser.add_argument("--v0", metavar="V", help="joint velocities, separated by commas (default: zeros)")
    parser.add_argument(
        "--record", type=int, metavar="K", help="record every K-th step (default: 10 000 samples at most)"
    )
    parser.add_argument(
        "--scene", metavar="FILE",
        help="what acts on the robot: a TOML file, see sd.Scene.from_toml; the options below are added to it",
    )  # fmt: skip
    parser.add_argument(
        "--friction", nargs="?", const="", metavar="NAME=X,...",
        help="joint friction and damping of the URDF act, but for these coefficients of sd.Friction",
    )  # fmt: skip
    parser.add_argument("--friction-method", choices=WAYS, help=f"how friction acts (default: {WAYS[0]})")
    parser.add_argument("--limits", action="store_true", help="joints stop at their position limits")
    parser.add_argument(
        "--constraints", metavar="FILE",
        help="loops of the robot: a TOML file of [[constraint]]; joints that mimic others are coupled to them",
    )  # fmt: skip
    parser.add_argument(
        "--stabilization", type=float, metavar="S",
        help="seconds in which errors of the constraints die away (default: none are left, by projection)",
    )  # fmt: skip
    parser.add_argument("--ledger", metavar="FILE", help="draw the work of friction and constraints to a picture")
    parser.add_argument("--plot", metavar="FILE", help="draw q, v and energy to a PNG, SVG, PDF, JPG or WebP file")
    parser.add_argument("--report", metavar="FILE", help="write one HTML page of it all, which needs no network")
    parser.add_argument("--save", metavar="FILE", help="write the trajectory to an npz file, or a page of it (.html)")
    parser.add_argument("--view", action="store_true", help="play the motion in the browser")
    add_quiet(parser)
    parser.set_defaults(run=_run)


def _methods() -> str:
    return f"one of {', '.join(integrators)} (default: rk4; where friction or limits act by impulses, {STEPPED})"


def _run(arguments: argparse.Namespace) -> int:
    check_plot(arguments.plot)
    check_plot(arguments.ledger, "--ledger")
    check_report(arguments.report)
    page = _check_save(arguments.save)
    if page or arguments.view:
        viser_module()  # raises before the simulation if viser is missing
    text = None if arguments.scene is None else text_of("--scene", arguments.scene)
    coupled = arguments.constraints is not None or (text is not None and "[[constraint]]" in text)
    with shown("reading", "robots", arguments.quiet):
        model = load(arguments, mimic=not coupled)
        compile_calls(model, ("kinetic_energy", "potential_energy"))  # else Ctrl-C has to wait for them
    scene = _scene(model, text, arguments)
    works = any(name != "springs" for name in scene.acts)
    if arguments.ledger and not works:
        raise SpatialDynError(
            "--ledger was given, expected --scene, --friction, --limits or --constraints beside it: no other work is "
            "done"
        )
    q0 = start_of(model, scene.constraints, arguments)
    v0 = parse_numbers("--v0", arguments.v0, model.nv)
    stopped = None
    with warnings.catch_warnings(record=True) as caught, shown("simulating", "steps", arguments.quiet) as report:
        warnings.simplefilter("always")
        try:
            run = simulate(
                scene,
                q0,
                np.zeros(model.nv) if v0 is None else v0,
                arguments.duration,
                arguments.dt,
                arguments.method,
                record=_recorded(scene, arguments.record),
                progress=report,
            )
        except SimulationInterrupt as interrupt:
            run, stopped = interrupt.trajectory, interrupt
    ledger = energy_ledger(run) if works else None
    for line in _report(model, run, ledger, scene.limits):
        print(line)
    for warning in caught:
        print(f"note    {_note(str(warning.message))}")
    if arguments.save:
        if page:
            with notes():
                drawn = view(run)
            drawn.save(arguments.save)
        else:
            _write("--save", arguments.save, run.save)
        print(f"saved   {arguments.save}")
    if arguments.plot:
        _write("--plot", arguments.plot, lambda path: run.plot(path=path))
        print(f"drawn   {arguments.plot}")
    if arguments.ledger and ledger is not None:
        _write("--ledger", arguments.ledger, lambda path: ledger.plot(path=path))
        print(f"drawn   {arguments.ledger}")
    if arguments.report:
        run.report(arguments.report)
        print(f"written {arguments.report}")
    if arguments.view and stopped is None:
        with notes():
            drawn = view(run)
        keep_open(drawn)
    if stopped is not None:
        raise stopped  # ``main`` reports it in one line
    return 0


def _note(text: str) -> str:
    """A warning of ``simulate`` without its Python code, and with this command's option."""
    what, of, _ = text.partition(" unless friction=True")
    return f"{what} unless --friction" if of else text


def _recorded(scene: Scene, every: int | None) -> Any:
    """The records of a run: work of all effects, and contacts."""
    works = any(name != "springs" for name in scene.acts)
    return (every, *["work"] * works, *["contacts"] * ("contacts" in scene.acts))


def _check_save(path: str | None) -> bool:
    """Whether the file of --save is a page. Raises SpatialDynError unless it is a page or an npz file."""
    if path is None:
        return False
    check_ending("--save", path, (*ARRAY_FILES, *PAGE_FILES))
    check_file("--save", path)
    return path.lower().endswith(PAGE_FILES)


def start_of(model: Model, constraints: Constraints | None, arguments: argparse.Namespace) -> Array:
    """The positions to start from. Raises SpatialDynError."""
    given = parse_numbers("--q0", arguments.q0, model.nq)
    if given is not None:
        if arguments.seed is not None:
            raise SpatialDynError("--q0 and --seed were given, expected one of them")
        return given
    if arguments.seed is None:
        q0 = np.array(calls["neutral"](model))
        limited = np.isfinite(model.lower) & np.isfinite(model.upper)
        q0[limited] = 0.5 * model.lower[limited] + 0.5 * model.upper[limited]
    elif arguments.seed < 0:
        raise SpatialDynError(f"--seed is {arguments.seed}, expected a whole number of 0 or more")
    else:
        q0 = random_configuration(model, np.random.default_rng(arguments.seed))
    return q0 if constraints is None else close_loops(model, constraints, q0)


def _scene(model: Model, text: str | None, arguments: argparse.Namespace) -> Scene:
    """The scene of the file and the options. Raises SpatialDynError."""
    scene = Scene(model) if text is None else Scene.from_toml(model, text)
    changes: dict[str, Any] = {"friction": _friction(model, arguments), "friction_method": arguments.friction_method}
    changes |= {"constraints": _constraints(model, arguments.constraints), "stabilization": arguments.stabilization}
    changes |= {"limits": arguments.limits or None}
    return scene.with_(**{name: x for name, x in changes.items() if x is not None})


def _friction(model: Model, arguments: argparse.Namespace) -> Friction | None:
    """The friction of the options, None for none. Raises SpatialDynError."""
    if arguments.friction is None:
        return None
    changes: dict[str, float] = {}
    for word in filter(None, arguments.friction.split(",")):
        name, _, value = word.partition("=")
        try:
            changes[name.strip()] = float(value)
        except ValueError:
            raise SpatialDynError(f"--friction has {literal(word)}, expected NAME=NUMBER") from None
    names = [x.name for x in fields(Friction)]
    unknown = [name for name in changes if name not in names]
    if unknown:
        raise SpatialDynError(f"--friction has {unknown[0]}, expected some of {', '.join(names)}")
    return Friction.of(model, **changes)


def _constraints(model: Model, path: str | None) -> Constraints | None:
    """The constraints of a TOML file, None for none. Raises SpatialDynError."""
    if path is None:
        return None
    text = text_of("--constraints", path)
    found = Constraints.of_toml(model, text)
    couplers = couplers_of(model)
    return Constraints(model, [*found, *couplers]) if couplers else found


def _write(option: str, path: str, write: Callable[[str], None]) -> None:
    """Write a file. Raises SpatialDynError if the system refuses."""
    try:
        write(path)
    except OSError as error:
        raise SpatialDynError(
            f"{option} is {literal(path)}: {error.strerror}, expected a file that can be written"
        ) from None


def _report(model: Model, run: Trajectory, ledger: EnergyLedger | None, limits: bool) -> list[str]:
    """The report of a run in a few lines; limits: whether joints stop at their limits."""
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
    if ledger is not None:
        works = ", ".join(f"{kind} {x[-1].sum():.3g} J" for kind, x in ledger.work.items() if kind != "torque")
        lines.append(f"work    {works}; the integrator's error {ledger.error[-1]:.3g} J")
        far = float(abs(ledger.error).max())
    beyond = np.atleast_1d(((run.q < model.lower) | (run.q > model.upper)).any(axis=0))
    if beyond.any() and not limits:
        names = [j.name for j in model.joints[1:] if j.mimic is None and beyond[j.idx_q : j.idx_q + j.nq].any()]
        lines.append(f"note    joints pass their limits, which --limits stops them at: {', '.join(names)}")
    if not far <= LARGE * scale:
        cure = "rtol and atol" if method.family is None else "dt"
        drives = "drives" if ledger is None else "else drives"
        lines.append(
            f"warning energy changes by {_share(far, scale)} of its scale though nothing {drives} the robot, expected "
            f"at most {LARGE:.0%}: the motion is not to be trusted; reduce {cure}"
        )
    return lines


def _share(part: float, whole: float) -> str:
    return f"{100.0 * part / whole:.2g} %" if whole > 0.0 else "0 %" if part == 0.0 else "all"
