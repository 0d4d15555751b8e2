"""``simulate`` and ``hamilton_simulation``: they check arguments, run the time loop, return a Trajectory.

Ctrl-C and errors carry what has been recorded. The loop of methods with a fixed step is ``fixed_steps``; SciPy's is
``adaptive``.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, ParamSpec

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..calls.arguments import as_array, as_number
from ..calls.dynamics import calls
from ..calls.progress import Progress, check_progress, reporting
from ..errors import (
    NonFiniteError,
    ShapeError,
    SimulationError,
    SimulationInterrupt,
    SpatialDynError,
)
from ..model.model import Model
from .adaptive import run_adaptive
from .carried import carried
from .carried_runs import beside as rates_beside
from .carried_runs import check_carrying
from .constrained import held_by
from .contact_steps import touching
from .control_laws import Control, check_control
from .energy import exploded, scale_of
from .fixed_steps import Effects, run_fixed
from .friction_steps import check_rubbing, smooth_kernel
from .methods import Method, integrators
from .recorder import Recorder, Steps
from .scene import Scene, check_method, effects_in_scene, scene_of, warn_of_friction
from .springs import check_springs, has_springs
from .torques import torque_of
from .trajectory import Trajectory

Array = NDArray[np.float64]
P = ParamSpec("P")
SAMPLES = 10_000  # recorded by default, at most
RECORDED = ("work", "contacts")  # beside states


@effects_in_scene("simulate")
def simulate(
    scene: Scene | Model,
    q0: ArrayLike,
    v0: ArrayLike,
    duration: float,
    dt: float,
    method: str | None = None,
    torque: ArrayLike | Callable[..., Any] | None = None,
    record: int | str | Sequence[int | str] | None = None,
    progress: Progress = False,
    rtol: float = 1e-9,
    atol: float = 1e-12,
    control: Control | None = None,
    states: Mapping[str, ArrayLike] | None = None,
) -> Trajectory:
    """The motion of a robot from (q0, v0) over a duration, in steps of dt (the last one shorter if they do not fit).

    scene     Scene: the robot and what acts on it; a Model is a scene on which nothing else acts
    q0        (nq,)  joint positions [rad | m]; on the constraints, out of the ground and within the limits that act
    v0        (nv,)  joint velocities [rad/s | m/s]
    duration  [s]
    dt        [s]
    method    None: ``scene.method``, rk4 where all forces are smooth, semi_implicit_euler where impulses act; the
              result names it. Or one of ``scene.methods``; ``integrators`` says what each costs and preserves:
              explicit_euler, semi_implicit_euler, velocity_verlet, rk4  in (q, v), explicit, not symplectic
              symplectic_euler, stormer_verlet, implicit_midpoint, gauss4, gauss6, variational  symplectic, implicit;
              under constraints of positions stormer_verlet is RATTLE
              dop853, radau  SciPy's, with steps adapted to rtol and atol; dt is then the spacing of samples
    torque    joint torques [N m | N]: None for zero, (nv,), (steps, nv) each held over its step, a Python function
              ``f(t, q, v) -> tau`` or ``f(t, q, v, tau)`` that writes tau, or an ``@njit`` function of the latter kind,
              which never leaves compiled code. A function is called where the method needs it, and once more for every
              recorded sample
    record    k records every k-th step; by default every step of up to 10 000, else at most 10 000 evenly spaced ones.
              The first and the last state are always recorded. "work", or (k, "work"), records the work of all that
              acts, states that the method integrates with the motion: ``energy_ledger``. "contacts" records impulses,
              gaps and residuals, ``trajectory.contacts``
    progress  True for a bar (needs rich), or a function of the number of steps done and their total
    rtol, atol  tolerances of dop853 and radau
    control   a ``Control``: a law whose torque is added to ``torque``, with states of its own
    states    {name: array}  states beside q and v at the beginning: of the control law, "bristles" and, if recorded,
              work. Those left out start as their Spec says; ``Trajectory.end`` has those of a run that is to go on

    Quaternion, floating, planar and (cos, sin) joints move on their group. Ω is the symplectic form in the canonical
    coordinates (x, π) of charts (``canonical_coordinates``), which are (q, p) where v = q̇. A method in (q, v) that
    ignores the rate of M, such as velocity Verlet, is not symplectic once M depends on q.
    The velocity of a floating base is in its own frame, whose turn methods of order 1 follow to the order of dt: a body
    that spins at ω gains speed by some ω² dt / 2 of itself a second, so a ball that rolls on contacts needs a small dt.
    Explicit methods refuse a dt at which springs, or smooth friction, would grow. ``tau`` leaves springs out, and of
    motors is what was wanted.
    Explicit methods step a robot by one program if torque is no function, the scene has no fext and the robot is short
    enough (its freedoms times the evaluations of ``integrators`` at most 128). The program is compiled once per scene
    and method, 0.1 s for a two-link arm, 0.6 s for a Panda, 3 s for a humanoid by rk4, and cached on disk. All else
    runs in the table kernel, or, with impulses, constraints, control or work, in Python. The choice, and so every bit
    of the result, does not depend on the number of steps.

    Returns Trajectory.
    Raises  ShapeError; SpatialDynError for an invalid dt, duration or method, and for an effect given as an argument;
            SimulationError for a method that cannot take the scene, with those that can; and,
            with the recorded part as ``trajectory``, for a torque that is not finite, an implicit step
            that does not converge, and a motion that diverges: its state is not finite or, if neither a torque function
            nor fext acts, its energy rises by a hundred times what gravity, the torques and the initial motion account
            for;
            ConstraintError for a start that does not meet the constraints; SimulationError, with the time and their
            names, where they contradict each other or their rank changes; SimulationError for a start in the ground or
            beyond a limit, with its depth, and for a step of contacts that misses Coulomb's law by more than 0.01 m/s,
            beside dry joints 0.1 m/s;
            SimulationInterrupt, a KeyboardInterrupt, at Ctrl-C: its ``trajectory`` holds the recorded samples and the
            last state (with tau NaN if the torque function has not been called there).

    >>> import spatialdyn as sd
    >>> model = sd.load_urdf("two_link")
    >>> run = sd.simulate(model, [0.5, -0.3], [0.0, 0.0], 1.0, 0.01, "gauss4")
    >>> run.q.shape
    (101, 2)
    >>> bool(abs(run.energy - run.energy[0]).max() < 1e-5)
    True
    """
    scene = scene_of(scene)
    model, forces = scene.model, scene.fext
    chosen = _method(scene, method)
    q, v = _vector("q0", q0, (model.nq,)), _vector("v0", v0, (model.nv,))
    warn_of_friction(scene, "simulate")
    check_rubbing(model, scene.rubs, chosen.name, as_number(dt))
    every, works, kept = _wanted(record)
    check_carrying(check_control(control), works, chosen.name)
    p = calls["momentum"](model, q, v)
    if chosen.family is not None and chosen.family.moves == "p":  # both calls raise InertiaError at a singular M
        calls["velocity_from_momentum"](model, q, p)
    else:
        calls["aba"](model, q, v, np.zeros(model.nv))
    held = held_by(scene, q, v, as_number(dt))
    touch = touching(scene, kept, q, held)
    acting = Effects(held, scene.rubs, control, works, forces is not None, touch=touch)
    return _run(scene, q, v, p, chosen, duration, dt, torque, every, progress, rtol, atol, acting, states)


def _momenta_by_name(call: Callable[P, Trajectory]) -> Callable[P, Trajectory]:
    """``call`` that takes its momenta under their old name ``p0`` too, and refuses a velocity by name."""

    @functools.wraps(call)
    def named(*args: P.args, **kwargs: P.kwargs) -> Trajectory:
        for name in ("v0", "v"):
            if name in kwargs:
                cure = "sd.momentum(model, q0, v0) makes them of velocities, and sd.simulate takes velocities"
                raise SpatialDynError(f"{name} is given, expected p, the momenta M(q0) v0; {cure}")
        if "p0" in kwargs:
            kwargs["p"] = kwargs.pop("p0")
        return call(*args, **kwargs)

    return named


@_momenta_by_name
def hamilton_simulation(
    scene: Scene | Model,
    q0: ArrayLike,
    p: ArrayLike,
    duration: float,
    dt: float,
    method: str = "stormer_verlet",
    torque: ArrayLike | Callable[..., Any] | None = None,
    record: int | None = None,
    progress: Progress = False,
    rtol: float = 1e-9,
    atol: float = 1e-12,
) -> Trajectory:
    """The motion from a point (q0, p0) of phase space by Hamilton's equations: ``simulate`` with a symplectic method.

    p   (nv,)  joint momenta M(q0) v0 [kg m²/s | kg m/s], no velocities: ``sd.momentum(model, q0, v0)``; ``p0`` too

    Other arguments, result and errors are those of ``simulate``.

    >>> import spatialdyn as sd
    >>> model = sd.load_urdf("pendulum")
    >>> run = sd.hamilton_simulation(model, [1.0], p=[0.0], duration=10.0, dt=0.01)
    >>> bool(abs(run.energy - run.energy[0]).max() < 1e-3)
    True
    """
    scene = scene_of(scene)
    model = scene.model
    chosen = _method(scene, method)
    q, momenta = _vector("q0", q0, (model.nq,)), _vector("p", p, (model.nv,))
    warn_of_friction(scene, "hamilton_simulation")
    v = calls["velocity_from_momentum"](model, q, momenta)
    if scene.acts not in ((), ("fext",), ("springs",), ("fext", "springs")):
        return simulate(scene, q, v, duration, dt, method, torque, record, progress, rtol, atol)
    acting = Effects(pushed=scene.fext is not None)
    return _run(scene, q, v, momenta, chosen, duration, dt, torque, record, progress, rtol, atol, acting)


# --- arguments -------------------------------------------------------------------------------------------


def _method(scene: Scene, method: Any) -> Method:
    """The method of a run. Raises SpatialDynError."""
    return integrators[check_method(scene, scene.method if method is None else method, integrators)]


def _vector(name: str, value: ArrayLike, shape: tuple[int, ...]) -> Array:
    """A copy in C order of a finite array of exactly that shape."""
    x = as_array(name, value)
    if x.shape != shape:
        raise ShapeError(f"{name} has shape {x.shape}, expected {shape}")
    if not np.isfinite(x).all():
        raise NonFiniteError(f"{name} is {x.tolist()}, expected finite numbers")
    return np.array(x, order="C")


def _wanted(record: Any) -> tuple[int | None, bool, bool]:
    """The argument ``record`` as its number of steps, and whether work and contacts are recorded."""
    asked = [*record] if isinstance(record, (tuple, list)) else [record]
    words = [x for x in asked if isinstance(x, str)]
    numbers = [x for x in asked if not isinstance(x, str)]
    if not asked or len(numbers) > 1 or not {*words} <= {*RECORDED}:
        raise SpatialDynError(f"record is {record!r}, expected a number of steps, {' or '.join(RECORDED)}, or several")
    return (numbers[0] if numbers else None), "work" in words, "contacts" in words


def _every(record: int | None, total: int) -> int:
    if record is None:
        return max(1, math.ceil(total / SAMPLES))
    if isinstance(record, bool) or not isinstance(record, (int, np.integer)) or record < 1:
        raise SpatialDynError(f"record is {record!r}, expected a whole number of steps of 1 or more")
    return min(int(record), 1 << 53)  # kernels count in int64; no run has as many steps


# --- the run ---------------------------------------------------------------------------------------------


def _run(
    scene: Scene, q: Array, v: Array, p: Array, method: Method, duration: float, dt: float, torque: Any,
    record: int | None, progress: Progress, rtol: float, atol: float, acting: Effects, states: Any = None,
) -> Trajectory:  # fmt: skip
    model, fext = scene.model, scene.fext
    steps = Steps.of(duration, dt)
    for name, x in (("rtol", rtol), ("atol", atol)):
        if not 0.0 < as_number(x) < math.inf:
            raise SpatialDynError(f"{name} is {x!r}, expected a finite number above 0")
    check_progress(progress)
    check_springs(model, method.name, q, steps.dt)
    acting = acting._replace(springs=has_springs(model))
    beside = carried(model, acting.carried, acting.static, states)
    recorder = Recorder(scene, method, steps, _every(record, steps.total), beside, acting.touch)
    recorder.put(q, p if recorder.moves_p else v, np.full(model.nv, np.nan))  # its torque may never be computed
    try:
        asked = torque_of(torque, model.nv, steps)
        recorder.rows[2][0] = asked.at(0, 0.0, q, v)
        with reporting(progress, "simulate") as report:
            if method.family is None:
                resist = None if acting.found is None else smooth_kernel(acting.found)
                acts = rates_beside(recorder, acting.control, acting.work, resist, fext)
                run_adaptive(recorder, q, v, asked, fext, report, (rtol, atol), acts)
            else:
                run_fixed(recorder, (q, v, p), asked, fext, report, acting)
    except KeyboardInterrupt as interrupt:
        trajectory = recorder.trajectory(acting.control, interrupted=True)
        stopped = SimulationInterrupt(f"interrupted at t = {trajectory.t[-1]:g} s of {duration:g} s")
        stopped.trajectory = trajectory
        raise stopped from interrupt
    except SimulationError as error:
        error.trajectory = recorder.trajectory(acting.control)
        raise
    trajectory = recorder.trajectory(acting.control)
    if asked.user is None and fext is None and acting.control is None and not acting.springs:  # their work is unknown
        T, V = recorder.split
        at = exploded(trajectory.t, trajectory.v, T, V, abs(asked.held).max(axis=0), recorder.kept)
        if at is not None:
            risen, t = trajectory.energy[at] - trajectory.energy[0], trajectory.t[at]
            finer = f"dt, to {steps.dt / 4:g} s say instead of {steps.dt:g}"
            cure = "rtol and atol" if method.family is None else finer
            diverged = SimulationError(
                f"{method.name} diverged at t = {t:.9g} s: the energy has risen by {risen:.3g} J, where gravity and "
                f"the motion at the beginning account for {scale_of(T, V)[at]:.3g} J; reduce {cure}"
            )
            diverged.trajectory = trajectory
            raise diverged
    return trajectory
