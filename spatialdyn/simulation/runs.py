"""``simulate`` and ``hamilton_simulation``: they check arguments, run the time loop, return a Trajectory.

Ctrl-C and errors carry the samples recorded so far.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from typing import Any, NamedTuple, ParamSpec

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..calls.arguments import as_array, as_number
from ..calls.dynamics import calls
from ..calls.progress import Progress, check_progress, reporting
from ..control.control import Control, check_control
from ..errors import (
    NonFiniteError,
    ShapeError,
    SimulationError,
    SimulationInterrupt,
    SpatialDynError,
    literal,
)
from ..model.model import Model
from .effects.control import Feedback, check_law
from .fixed_steps import run_sample
from .methods.methods import Method
from .plan import Inputs, method_of, plan_of
from .recorder import Recorder, Steps, exploded, scale_of
from .scene import Scene, effects_in_scene, scene_of, warn_of_friction
from .stable_steps import check_smooth_friction, check_springs
from .states import run_states
from .stiff_laws import warn_of_stiff_law
from .torques import Torque, check_force, torque_of
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
    fext: ArrayLike | Callable[[float, Array, Array], ArrayLike] | None = None,
) -> Trajectory:
    """The motion of a robot from (q0, v0) over a duration, in steps of dt (the last one shorter if they do not fit).

    scene     Scene: the robot and what acts on it; a Model is a scene on which nothing else acts
    q0        (nq,)  joint positions [rad | m]; they must satisfy the constraints, the ground and the limits that act
    v0        (nv,)  joint velocities [rad/s | m/s]
    duration  [s]
    dt        [s]
    method    None: ``scene.method``, rk4 if all forces are smooth, semi_implicit_euler if impulses act; the result
              names it. Or one of ``scene.methods``; ``integrators`` lists their costs and invariants:
              explicit_euler, semi_implicit_euler, velocity_verlet, rk4  in (q, v), explicit, not symplectic
              symplectic_euler, stormer_verlet, implicit_midpoint, gauss4, gauss6, variational  symplectic, implicit;
              under constraints of positions stormer_verlet is RATTLE
              dop853, radau  SciPy's, with steps adapted to rtol and atol; dt is then the spacing of samples
    torque    joint torques [N m | N]: None for zero, (nv,), (steps, nv) each held over its step, a Python function
              ``f(t, q, v) -> tau`` or ``f(t, q, v, tau)`` that writes tau, or an ``@njit`` function of the latter kind,
              which compiled loops call directly. A function is called whenever the method needs it, and once more for
              every recorded sample
    record    k records every k-th step; by default every step of up to 10 000, else at most 10 000 evenly spaced ones.
              The first and the last state are always recorded. "work", or (k, "work"), records the work of all effects,
              which the method integrates with the motion: ``energy_ledger``. "contacts" records impulses, gaps and
              residuals, ``trajectory.contacts``
    progress  True for a progress bar (needs rich), or a function of the number of steps done and their total
    rtol, atol  tolerances of dop853 and radau
    control   a ``Control``: a law whose torque is added to ``torque``, with states of its own. If a law of the library
              is too stiff for dt, so that an explicit step amplifies errors that the motion itself damps, one warning
              names the joint (PD: if ω h is 2 √(1 + ζ²) - 2 ζ or more, ``largest_step``). A law that is held for a
              period is checked over this period
    states    {name: array}  states beside q and v at the beginning: of the control law, "bristles" and, if recorded,
              work. States left out start with the values in their Spec; ``Trajectory.end`` has the states to continue a
              run
    fext      external forces that vary, beside those of the scene: (steps, njoints, 6), each held over its step, or a
              function ``f(t, q, v) -> (njoints, 6)``, called whenever the method needs forces; they act on each joint's
              body, in the joint's frame [N | N m]

    Quaternion, floating, planar and (cos, sin) joints move on their group. Ω is the symplectic form in the canonical
    coordinates (x, π) of charts (``canonical_coordinates``), which are (q, p) where v = q̇. A method in (q, v) that
    ignores the rate of M, such as velocity Verlet, is not symplectic once M depends on q.
    The velocity of a floating base is in its own frame. ``semi_implicit_euler`` turns it with the body after forces and
    impulses are known: a ball that rolls keeps its speed, and momenta of a free body are of order 2; ``explicit_euler``
    turns it to order 1 only. Explicit methods refuse a dt at which springs or smooth friction are unstable. The
    recorded ``tau`` does not include springs; with motors it is the commanded torque.
    In methods in momenta, states of a law that have rates are integrated for half a step before and half a step after
    the motion, to order 2; only a clock is that of each stage. Work is integrated as the motion is; in methods in
    momenta by their stages, or the trapezoidal rule. Explicit methods, and methods in momenta if only tau and fext act,
    step a robot by one program if neither torque nor fext is a function and the robot is short enough: its freedoms
    times the evaluations of ``integrators`` are at most 128. The program is compiled once per scene and method, which
    takes longer with more joints and stages, and cached on disk. Other runs use the table kernel or, with effects, and
    in momenta with a function, Python. This choice, and so every bit of the result, depends neither on the number of
    steps nor, except for SciPy's methods, on the number of samples in a ``rollout``.

    Returns Trajectory.
    Raises  ShapeError; SpatialDynError for an invalid dt, duration or method, and for an effect given as an argument;
            SimulationError for a method that cannot take the scene, with those that can; and,
            with the recorded part as ``trajectory``, for a torque that is not finite, an implicit step
            that does not converge, and a motion that diverges: its state is not finite or, if neither a torque function
            nor forces act, its energy rises by a hundred times what gravity, the torques and the initial motion account
            for;
            ConstraintError for a start that violates the constraints; SimulationError, with the time and their names,
            if constraints contradict each other or their rank changes; SimulationError for a start in the ground or
            beyond a limit, with its depth, and for a step of contacts that violates Coulomb's law by more than
            0.01 m/s, beside dry joints 0.1 m/s;
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
    model, way = scene.model, method_of(scene, method)
    q, v = _vector("q0", q0, (model.nq,)), _vector("v0", v0, (model.nv,))
    warn_of_friction(scene, "simulate")
    wanted = _Wanted.of(record)
    if control is not None:
        check_law(check_control(control), way.name)
    p, family = v, way.family
    if family is not None and family.moves == "p":
        p = calls["momentum"](model, q, v)
        calls["velocity_from_momentum"](model, q, p)  # raises InertiaError at a singular M
    elif model.nq != model.nv:
        calls["potential_energy"](model, q)  # raises ConfigurationError naming the joint
    times, tolerances = (duration, dt), (rtol, atol)
    return _run(scene, way, (q, v, p), times, torque, fext, wanted, progress, tolerances, control, states)


def _momenta_by_name(call: Callable[P, Trajectory]) -> Callable[P, Trajectory]:
    """Make ``call`` accept momenta under their old name ``p0`` too, and refuse a velocity by name."""

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

    p   (nv,)  joint momenta M(q0) v0 [kg m²/s | kg m/s], not velocities: ``sd.momentum(model, q0, v0)``; also called
        ``p0``

    Other arguments, result and errors are those of ``simulate``.

    >>> import spatialdyn as sd
    >>> model = sd.load_urdf("pendulum")
    >>> run = sd.hamilton_simulation(model, [1.0], p=[0.0], duration=10.0, dt=0.01)
    >>> bool(abs(run.energy - run.energy[0]).max() < 1e-3)
    True
    """
    scene = scene_of(scene)
    model, way = scene.model, method_of(scene, method)
    q, momenta = _vector("q0", q0, (model.nq,)), _vector("p", p, (model.nv,))
    warn_of_friction(scene, "hamilton_simulation")
    v = calls["velocity_from_momentum"](model, q, momenta)
    wanted, times, tolerances = _Wanted.of(record), (duration, dt), (rtol, atol)
    return _run(scene, way, (q, v, momenta), times, torque, None, wanted, progress, tolerances)


# --- arguments -------------------------------------------------------------------------------------------


def _vector(name: str, value: ArrayLike, shape: tuple[int, ...]) -> Array:
    """A copy in C order of a finite array of exactly that shape."""
    x = as_array(name, value)
    if x.shape != shape:
        raise ShapeError(f"{name} has shape {x.shape}, expected {shape}")
    if not np.isfinite(x).all():
        raise NonFiniteError(f"{name} is {x.tolist()}, expected finite numbers")
    return np.array(x, order="C")


class _Wanted(NamedTuple):
    """The records of a run: every how many steps, whether work, whether contacts."""

    every: int | None
    work: bool
    contacts: bool

    @classmethod
    def of(cls, record: Any) -> _Wanted:
        """The records for the argument ``record``. Raises SpatialDynError."""
        asked = [*record] if isinstance(record, (tuple, list)) else [record]
        words = [x for x in asked if isinstance(x, str)]
        numbers = [x for x in asked if not isinstance(x, str)]
        if not asked or len(numbers) > 1 or not {*words} <= {*RECORDED}:
            known = " or ".join(RECORDED)
            raise SpatialDynError(f"record is {literal(record)}, expected a number of steps, {known}, or several")
        return cls(numbers[0] if numbers else None, "work" in words, "contacts" in words)


def _varying(scene: Scene, fext: Any, total: int) -> Inputs:
    """The external forces of a run."""
    model = scene.model
    if fext is None:
        return Inputs()
    if callable(fext):
        check_force(fext)
        base = scene.fext
        return Inputs(force=fext if base is None else lambda t, q, v: base + as_array("fext", fext(t, q, v)))
    x = as_array("fext", fext)
    if x.shape == (model.njoints, 6):
        raise SimulationError("fext is constant, an option of the scene, expected sd.Scene(model, fext=fext)")
    if x.shape != (total, model.njoints, 6):
        raise ShapeError(f"fext has shape {x.shape}, expected {(total, model.njoints, 6)}, a row per step")
    if not np.isfinite(x).all():
        raise NonFiniteError("fext has numbers that are not finite, expected finite ones")
    return Inputs(x)


def _every(record: int | None, total: int) -> int:
    if record is None:
        return max(1, math.ceil(total / SAMPLES))
    if isinstance(record, bool) or not isinstance(record, (int, np.integer)) or record < 1:
        raise SpatialDynError(f"record is {literal(record)}, expected a whole number of steps of 1 or more")
    return min(int(record), 1 << 53)  # kernels count in int64; no run has as many steps


# --- the run ---------------------------------------------------------------------------------------------


def _run(
    scene: Scene, method: Method, start: tuple[Array, Array, Array], times: tuple[float, float], torque: Any, fext: Any,
    wanted: _Wanted, progress: Progress, tolerances: tuple[float, float], control: Control | None = None,
    states: Any = None,
) -> Trajectory:  # fmt: skip
    """``simulate`` from start (q, v, p), for times (duration, dt)."""
    model, (q, v, p), steps = scene.model, start, Steps.of(*times)
    for name, x in zip(("rtol", "atol"), tolerances, strict=True):
        if not 0.0 < as_number(x) < math.inf:
            raise SpatialDynError(f"{name} is {literal(x)}, expected a finite number above 0")
    if progress is not False:
        check_progress(progress)
    if scene.effects:
        check_smooth_friction(scene, method.name, steps.dt)
        check_springs(scene, method.name, q, steps.dt)
    inputs = _varying(scene, fext, steps.total)
    if control is not None:
        inputs = inputs._replace(feedback=Feedback.of(control, model, 1, steps.total))
    fixed = 0.0 if method.family is None else steps.dt
    plan = plan_of(scene, method.name, (q, v), fixed, wanted.work, wanted.contacts, inputs)
    initial = plan.unstarted if states is None else run_states(model, plan.states, plan.tables, states)
    recorder = Recorder(plan, steps, _every(wanted.every, steps.total), initial)
    if control is not None:
        warn_of_stiff_law(plan, control, (q, v), np.zeros((1, 1, model.nv)), steps.dt, 5)
    recorder.put(q, p if recorder.moves_p else v, np.full(model.nv, np.nan))  # its torque may never be computed
    try:
        asked = Torque(np.zeros((1, model.nv))) if torque is None else torque_of(torque, model.nv, steps)
        recorder.rows[2][0] = 0.0 if torque is None else asked.at(0, 0.0, q, v)
        with nullcontext() if progress is False else reporting(progress, "simulate") as report:
            run_sample(plan, recorder, (q, v, p), asked, report, tolerances=tolerances)
    except KeyboardInterrupt as interrupt:
        trajectory = recorder.trajectory(control, interrupted=True)
        stopped = SimulationInterrupt(f"interrupted at t = {trajectory.t[-1]:g} s of {times[0]:g} s")
        stopped.trajectory = trajectory
        raise stopped from interrupt
    except SimulationError as error:
        if recorder.at[0] == 0 and not recorder.moves_p:
            calls["aba"](model, q, v, np.zeros(model.nv))  # raises InertiaError naming the joint
        error.trajectory = recorder.trajectory(control)
        raise
    trajectory = recorder.trajectory(control)
    driven = asked.user is not None or control is not None or fext is not None or scene.fext is not None
    if not driven and not any(x.drives for x in scene.effects):  # otherwise the work that drives it is unknown
        _judge(trajectory, recorder, asked)
    return trajectory


def _judge(trajectory: Trajectory, recorder: Recorder, asked: Torque) -> None:
    """Raise SimulationError for a motion whose energy rises by more than its torques and gravity account for."""
    T, V = recorder.split
    at = exploded(trajectory.t, trajectory.v, T, V, abs(asked.held).max(axis=0), recorder.kept)
    if at is None:
        return
    method, dt = recorder.method, recorder.steps.dt
    risen, t = trajectory.energy[at] - trajectory.energy[0], trajectory.t[at]
    cure = "rtol and atol" if method.family is None else f"dt, to {dt / 4:g} s say instead of {dt:g}"
    diverged = SimulationError(
        f"{method.name} diverged at t = {t:.9g} s: the energy has risen by {risen:.3g} J, where gravity and "
        f"the motion at the beginning account for {scale_of(T, V)[at]:.3g} J; reduce {cure}"
    )
    diverged.trajectory = trajectory
    raise diverged
