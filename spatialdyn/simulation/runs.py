"""``simulate`` and ``hamilton_simulation``: they check arguments, run the time loop, return a Trajectory.

Ctrl-C and errors carry what has been recorded. The loop of methods with a fixed step is ``fixed_steps``; SciPy's is
``adaptive``.
"""

from __future__ import annotations

import functools
import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import Any, ParamSpec

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..actuation.friction import Friction
from ..actuation.motors import Motor
from ..calls.arguments import as_array, as_flag, as_number, check_model
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
from . import rattle
from .adaptive import run_adaptive
from .carried import carried
from .carried_runs import beside as rates_beside
from .carried_runs import check_carrying
from .constrained import held_by
from .contact_steps import touching
from .control_laws import Control, check_control
from .energy import exploded, scale_of
from .fixed_steps import FREE, HELD_SYMPLECTIC, Effects, run_fixed
from .friction_steps import IMPLICIT, SMOOTH, STEPPED, rubbing, smooth_kernel
from .methods import Method, integrators
from .recorder import Recorder, Steps
from .springs import check_springs, has_springs
from .torques import torque_of
from .traced_steps import EXPLICIT_METHODS
from .trajectory import Trajectory

Array = NDArray[np.float64]
P = ParamSpec("P")
SAMPLES = 10_000  # recorded by default, at most


def simulate(
    model: Model,
    q0: ArrayLike,
    v0: ArrayLike,
    duration: float,
    dt: float,
    method: str | None = None,
    torque: ArrayLike | Callable[..., Any] | None = None,
    fext: ArrayLike | None = None,
    record: int | str | Sequence[int | str] | None = None,
    progress: Progress = False,
    rtol: float = 1e-9,
    atol: float = 1e-12,
    constraints: Any = None,
    stabilization: float | None = None,
    friction: Friction | bool | None = None,
    friction_method: str = "implicit",
    motor: Motor | None = None,
    drive: str = "current",
    control: Control | None = None,
    states: Mapping[str, ArrayLike] | None = None,
    contacts: Any = None,
    limits: bool = False,
    record_contacts: bool = False,
) -> Trajectory:
    """The motion of a robot from (q0, v0) over a duration, in steps of dt (the last one shorter if they do not fit).

    q0        (nq,)  joint positions [rad | m]
    v0        (nv,)  joint velocities [rad/s | m/s]
    duration  [s]
    dt        [s]
    method    None: rk4 where all forces are smooth, semi_implicit_euler where impulses act (contacts, limits, dry
              friction, motors); the result names it. Or a name in ``integrators``, whose table says what each costs
              and preserves:
              explicit_euler, semi_implicit_euler, velocity_verlet, rk4  in (q, v), explicit, not symplectic
              symplectic_euler, stormer_verlet, implicit_midpoint, gauss4, gauss6, variational  symplectic, implicit
              dop853, radau  SciPy's, with steps adapted to rtol and atol; dt is then the spacing of samples
    torque    joint torques [N m | N]: None for zero, (nv,), (steps, nv) each held over its step, a Python function
              ``f(t, q, v) -> tau`` or ``f(t, q, v, tau)`` that writes tau, or an ``@njit`` function of the latter kind,
              which never leaves compiled code. A function is called where the method needs it, and once more for every
              recorded sample
    fext      (njoints, 6)  constant force on each joint's body, in the joint's frame [N | N m]
    record    k records every k-th step; by default every step of up to 10 000, else at most 10 000 evenly spaced ones.
              The first and the last state are always recorded. "work" or (k, "work") records the work of torques,
              friction and constraints too, states that the method integrates with the motion: ``energy_ledger``
    progress  True for a bar (needs rich), or a function of the number of steps done and their total
    rtol, atol  tolerances of dop853 and radau
    constraints    Constraints of this model, which (q0, v0) meets; explicit methods take them, and for equations of
              positions two symplectic ones: variational, and stormer_verlet, which is then RATTLE, for joints whose
              position is one number
    stabilization  T [s], at least 3 dt: errors of the constraints die away like exp(-t/T). If left out, each step ends
              with a projection onto the constraints: one Newton step of q, then v, the nearest in the metric of M.
              Beside implicit friction, contacts or limits v is not projected, which would move joints that stick: the
              impulses of the step meet J v = 0 at its end to the order of dt³, in an impact dt², whatever was left
              before. A branch point is seen in a step that begins or ends near one; a motion that passes it within a
              step goes on by one of the branches
    friction  friction and damping of the joints: True for that of the URDF, or a ``Friction``. With None none acts, and
               a warning says so where the URDF has some; with False none acts
    friction_method  how it acts:
               implicit  with method="semi_implicit_euler": Coulomb's law and damping hold at the end of a step, at any
                         dt; a joint that sticks has a velocity of 0 to the bit
               lugre     with the same method: LuGre's bristles, a state of their own that starts undeflected. Below the
                         static friction a joint bends them, and under a varying torque creeps
               smooth    a torque -F(v) tanh(v/smoothing) - viscous v, with any method but variational; nothing sticks:
                         a joint creeps under any torque. Explicit methods are stable up to a dt that is refused above
    motor, drive  Motor through which the torques act, with method="semi_implicit_euler" and implicit friction.
               "current": torque is n k_t i of the current wanted, and the motor gives what its limits allow.
               "voltage": torque is n k_t u / R of a voltage u, at rest; in motion the motor's own takes some away, as
               damping does. Either way the gear loses its part of the load as dry friction, so a joint may stick under
               load; ``tau`` of the result is what was wanted

    contacts  Contacts of this model, with method="semi_implicit_euler": points that touch the ground, with Coulomb's
              exact cone; see ``contact_step``. Constraints, dry joints, bristles, motors and springs act beside them
    limits    whether joints of one coordinate stop at their position limits, in the same steps
    record_contacts  whether ``trajectory.contacts`` holds impulses, gaps and residuals
    control   a ``Control``: a law whose torque is added to ``torque``, with states of its own
    states    {name: array}  states beside q and v at the beginning: of the control law, "bristles" and, if recorded,
              work. Those left out start as their Spec says; ``Trajectory.end`` has those of a run that is to go on

    Quaternion, floating, planar and (cos, sin) joints move on their group. Ω is the symplectic form in the canonical
    coordinates (x, π) of charts (``canonical_coordinates``), which are (q, p) where v = q̇. A method in (q, v) that
    ignores the rate of M, such as velocity Verlet, is not symplectic once M depends on q.
    The velocity of a floating base is in its own frame, whose turn methods of order 1 follow to the order of dt: a body
    that spins at ω gains speed by some ω² dt / 2 of itself a second, so a ball that rolls on contacts needs a small dt.
    With friction, contacts, control or record="work", which explicit methods and SciPy's take, torque functions, fext
    and robots too long for a program make the steps run in Python.
    Springs of series-elastic joints (``ModelBuilder.add_series_elastic``) act by themselves; ``tau`` leaves them out.
    With them explicit methods refuse a dt at which motions of springs and inertias, by the M of the start, would grow.
    Explicit methods step a robot by one program if torque is no function, fext is None and the robot is short enough
    (its freedoms times the evaluations of ``integrators`` at most 128). The program is compiled once per model and
    method, 0.1 s for a two-link arm, 0.6 s for a Panda, 3 s for a humanoid by rk4, and cached on disk. All else runs in
    the table kernel. The choice, and so every bit of the result, does not depend on the number of steps.

    Returns Trajectory.
    Raises  ShapeError; SpatialDynError for an invalid dt, duration or method; ModelError for springs, constraints
            or points in contact with mimic joints;
            SimulationError for a friction_method that the method cannot take, or whose coefficients are missing; and,
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
    if method is None:
        dry = friction is not None and friction is not False and friction_method != SMOOTH
        acts = dry or contacts is not None or as_flag("limits", limits) or motor is not None
        method = STEPPED if acts else "rk4"
    q, v, chosen, forces = _checked(model, q0, ("v0", v0), method, fext, friction is None)
    found = rubbing(model, friction, friction_method, method, as_number(dt), motor, drive)
    every, works = _wanted(record)
    check_carrying(check_control(control), works, chosen.name)
    p = calls["momentum"](model, q, v)
    if chosen.family is not None and chosen.family.moves == "p":  # both calls raise InertiaError at a singular M
        calls["velocity_from_momentum"](model, q, p)
    else:
        calls["aba"](model, q, v, np.zeros(model.nv))
    known = [*EXPLICIT_METHODS, *HELD_SYMPLECTIC]
    solved = contacts is not None or as_flag("limits", limits) or (found is not None and found.way == IMPLICIT)
    held = held_by(model, constraints, stabilization, chosen.name, known, q, v, as_number(dt), solved)
    if held is not None and chosen.name in HELD_SYMPLECTIC:
        rattle.check_symplectic(model, held, chosen.name)
    touch = touching(model, contacts, limits, record_contacts, chosen.name, q, found, held)
    acting = Effects(held, found, control, works, forces is not None, touch=touch)
    return _run(model, q, v, p, chosen, duration, dt, torque, forces, every, progress, rtol, atol, acting, states)


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
    model: Model,
    q0: ArrayLike,
    p: ArrayLike,
    duration: float,
    dt: float,
    method: str = "stormer_verlet",
    torque: ArrayLike | Callable[..., Any] | None = None,
    fext: ArrayLike | None = None,
    record: int | None = None,
    progress: Progress = False,
    rtol: float = 1e-9,
    atol: float = 1e-12,
) -> Trajectory:
    """The motion from a point (q0, p0) of phase space by Hamilton's equations: ``simulate`` with a symplectic method.

    p   (nv,)  joint momenta M(q0) v0 [kg m²/s | kg m/s], no velocities: ``sd.momentum(model, q0, v0)``; ``p0`` too

    Other arguments, result and errors are those of ``simulate``; every method is accepted.

    >>> import spatialdyn as sd
    >>> model = sd.load_urdf("pendulum")
    >>> run = sd.hamilton_simulation(model, [1.0], p=[0.0], duration=10.0, dt=0.01)
    >>> bool(abs(run.energy - run.energy[0]).max() < 1e-3)
    True
    """
    q, momenta, chosen, forces = _checked(model, q0, ("p", p), method, fext)
    v = calls["velocity_from_momentum"](model, q, momenta)
    return _run(model, q, v, momenta, chosen, duration, dt, torque, forces, record, progress, rtol, atol)


# --- arguments -------------------------------------------------------------------------------------------


def _checked(
    model: Model, q0: ArrayLike, moving: tuple[str, ArrayLike], method: str, fext: ArrayLike | None, warn: bool = True
) -> tuple[Array, Array, Method, Array | None]:
    check_model(model)
    try:
        chosen = integrators[method]
    except (KeyError, TypeError):
        raise SpatialDynError(f"method is {method!r}, expected one of {', '.join(integrators)}") from None
    name, w0 = moving
    q, w = _vector("q0", q0, (model.nq,)), _vector(name, w0, (model.nv,))
    forces = None if fext is None else _vector("fext", fext, (model.njoints, 6))
    if warn and (model.damping.any() or model.friction.any()):
        ours = name == "v0"  # of simulate
        call, cure = ("simulate", " unless friction=True") if ours else ("hamilton_simulation", "; simulate takes them")
        text = f'robot "{model.name}" has joint damping or friction, which {call} ignores{cure}'
        warnings.warn(text, stacklevel=3 if ours else 4)  # a wrapper stands around the other
    return q, w, chosen, forces


def _vector(name: str, value: ArrayLike, shape: tuple[int, ...]) -> Array:
    """A copy in C order of a finite array of exactly that shape."""
    x = as_array(name, value)
    if x.shape != shape:
        raise ShapeError(f"{name} has shape {x.shape}, expected {shape}")
    if not np.isfinite(x).all():
        raise NonFiniteError(f"{name} is {x.tolist()}, expected finite numbers")
    return np.array(x, order="C")


def _wanted(record: Any) -> tuple[int | None, bool]:
    """The argument ``record`` as its number of steps, and whether work is recorded."""
    asked = [*record] if isinstance(record, (tuple, list)) else [record]
    numbers = [x for x in asked if not (isinstance(x, str) and x == "work")]
    if not asked or len(numbers) > 1 or any(isinstance(x, str) for x in numbers):
        raise SpatialDynError(f'record is {record!r}, expected a number of steps, "work", or both')
    return (numbers[0] if numbers else None), len(numbers) < len(asked)


def _every(record: int | None, total: int) -> int:
    if record is None:
        return max(1, math.ceil(total / SAMPLES))
    if isinstance(record, bool) or not isinstance(record, (int, np.integer)) or record < 1:
        raise SpatialDynError(f"record is {record!r}, expected a whole number of steps of 1 or more")
    return min(int(record), 1 << 53)  # kernels count in int64; no run has as many steps


# --- the run ---------------------------------------------------------------------------------------------


def _run(
    model: Model, q: Array, v: Array, p: Array, method: Method, duration: float, dt: float, torque: Any,
    fext: Array | None, record: int | None, progress: Progress, rtol: float, atol: float,
    acting: Effects = FREE, states: Any = None,
) -> Trajectory:  # fmt: skip
    steps = Steps.of(duration, dt)
    for name, x in (("rtol", rtol), ("atol", atol)):
        if not 0.0 < as_number(x) < math.inf:
            raise SpatialDynError(f"{name} is {x!r}, expected a finite number above 0")
    check_progress(progress)
    check_springs(model, method.name, q, steps.dt)
    acting = acting._replace(springs=has_springs(model))
    if acting.held is not None and method.name in HELD_SYMPLECTIC and acting.springs:
        raise SimulationError(f"{method.name} under constraints is given springs, expected an explicit method")
    beside = carried(model, acting.carried, acting.static, states)
    recorder = Recorder(model, method, steps, _every(record, steps.total), beside, acting.touch)
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
