"""Many simulations at once: a step of a method of ``explicit`` is traced into a program, which runs on SIMD lanes.

A step is recorded as any recursion is. The loop over the steps is compiled too: it takes one register of samples after
another through all steps, their states in the first-level cache.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import lru_cache
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from ..calls.arguments import as_array, as_flag, as_number, broadcast
from ..calls.dynamics import calls
from ..engines.compiled import numba_kernels
from ..engines.programs import float32_range, recording, time_loop
from ..engines.programs.program import Program
from ..engines.programs.time_loop import StepInput
from ..engines.programs.tracer import table
from ..errors import ConstraintError, ModelError, ShapeError, SimulationError
from ..model.model import Model
from ..model.robot_checks import masked
from ..recursions.friction import BRISTLES
from ..recursions.spec import Argument, Spec
from . import explicit
from .carried import carried
from .constrained import Held, accelerate, held_by, projected
from .contact_steps import Touching, check_few, samples_unsolved, touching, unsolved
from .control_laws import Control, check_control, step_kernel
from .costs import Cost, check_cost, with_cost
from .friction_steps import UNSOLVED, VIOLATION, Rubbing, check_rubbing
from .methods import EXPLICIT_METHODS
from .rollout_result import PD, Rollout, with_pd
from .scene import Scene, check_method, effects_in_scene, scene_of, warn_of_friction
from .solved_steps import solver
from .springs import check_springs, has_springs
from .system import State, System, held_torque
from .traced_steps import carried_by, step_specs

Array = NDArray[Any]


@effects_in_scene("rollout")
def rollout(
    scene: Scene | Model,
    q0: ArrayLike,
    v0: ArrayLike,
    tau: ArrayLike | None = None,
    *,
    dt: float,
    steps: int | None = None,
    method: str | None = "semi_implicit_euler",
    pd: PD | None = None,
    record: int | str | Sequence[int | str] | None = None,
    dtype: DTypeLike = np.float64,
    check: bool = True,
    control: Control | None = None,
    states: Mapping[str, ArrayLike] | None = None,
    cost: Cost | None = None,
) -> Rollout:
    """Simulate a batch of states over many steps, all of it in compiled code.

    scene   Scene: the robot and what acts on it; a Model is a scene on which nothing else acts
    q0      (B, nq) or (nq,)  positions at the beginning [rad | m]
    v0      (B, nv) or (nv,)  velocities [rad/s | m/s]
    tau     (nv,), (T, nv) or (B, T, nv)  torques, held over each step [N m | N]; zero if left out
    dt      step [s]
    steps   T; needed if neither tau nor pd has an axis T
    method  "semi_implicit_euler", which takes every scene, "explicit_euler", "velocity_verlet" or "rk4", as in
            ``simulate``; None for ``scene.method``
    pd      a control law, added to tau
    record  1 for the state after every step, k after every k-th, "last" for the last alone (of no steps, the first);
            left out, 1, or "last" with a cost. "contacts", or (k, "contacts"), records impulses, gaps and residuals
    dtype   float64, or float32: faster, with errors of some 1e-6 a step; numbers below its range, 1e-38, are flushed to
            0, and robots with inertias outside 1e-18 to 1e18 (kg, kg m²) are computed in float64
    check   whether a state that is not finite is an error, and friction or a contact that is not solved; if not, it
            stays
    control  a Control, whose torque is added to tau; its values may have axes of samples and steps. Not with pd
    states   {name: (B, ...) or (...)}  states beside q and v at the beginning, of the control law and "bristles": those
             left out start as their Spec says
    cost     a Cost, summed over the steps in their program: ``run.cost`` (B,), beside the last state alone unless
             ``record`` says otherwise, which then records the sums so far too. Not with pd

    A scene may have at most 36 equations of constraints, in float64; 12 points in contact, and beside dry joints or
    constraints 36 impulses: three of a point, one of a joint. Coefficients of friction and contacts are inputs: others
    compile nothing.
    The first use for a model, method and kind of input compiles a program (0.1 s to a few seconds) and caches it.

    Returns a Rollout, which unpacks as (q, v).
    Raises
        ShapeError for shapes that do not match
        SimulationError for an invalid dt, steps, record, dtype or method, and for a state or cost that is not finite,
            naming the sample and the time; for friction as ``simulate``, and where check finds Coulomb's law violated
            by more than 0.01 rad/s or m/s, or a contact's, naming sample, time and point; TypeError naming the Spec of
            a law or cost that cannot be recorded
        InertiaError naming a joint with zero articulated inertia
        ConfigurationError naming a joint whose quaternion or (cos, sin) is not of norm 1 within 1e-6
        ModelError for springs, constraints or points in contact with mimic joints, a kp of a joint whose position is
            not one number, and more than 12 points in contact
        ConstraintError for a start that does not meet the constraints; SimulationError naming sample, time and
            constraints where they contradict each other or their rank changes
        KeyboardInterrupt at Ctrl-C, checked between slices of samples and steps; no bit depends on the slices

    >>> import numpy as np, spatialdyn as sd
    >>> model = sd.load_urdf("two_link")
    >>> hold = sd.PD(kp=[40.0, 40.0], kd=[8.0, 8.0], q_ref=[0.5, 0.0])
    >>> q, v = sd.rollout(model, np.zeros((100, 2)), np.zeros((100, 2)), dt=1e-3, steps=500, pd=hold)
    >>> q.shape
    (100, 500, 2)
    """
    scene = scene_of(scene)
    model, found = scene.model, scene.rubs
    method = check_method(scene, scene.method if method is None else method, EXPLICIT_METHODS)
    if scene.fext is not None:
        raise SimulationError("fext acts in the scene, expected None in a rollout; simulate takes it")
    warn_of_friction(scene, "rollout")
    number, check = _dtype(dtype), as_flag("check", check)
    if not (_is_number(dt) and math.isfinite(dt) and dt > 0.0):
        raise SimulationError(f"dt is {dt!r}, expected a positive number of seconds")
    check_rubbing(model, found, method, float(dt))
    if check_control(control) is not None and pd is not None:
        raise SimulationError("control and pd are given, expected one of them")
    kept, record = _of_contacts(record)
    if cost is not None:
        if pd is not None:
            raise SimulationError("cost and pd are given, expected control in place of pd")
        control, record = with_cost(control, check_cost(cost)), "last" if record is None else record
    forcing = {} if tau is None else {"tau": (as_array("tau", tau), model.nv)}
    if pd is not None:
        forcing |= _law(model, pd)
    start, axes = _states(model, q0, v0), {name: x.shape[:-1] for name, (x, _) in forcing.items()}
    if control is not None:
        axes |= control.axes(model)
    several = {name: lead[:1] for name, lead in axes.items() if len(lead) == 2}
    (B,) = broadcast(["q0", "v0", *several], [start[0].shape[:1], start[1].shape[:1], *several.values()])
    T = _steps(steps, {name: lead[-1] for name, lead in axes.items() if lead})
    inputs = {name: _step_input(name, x, (B, T, columns)) for name, (x, columns) in forcing.items()}
    inputs = {"dt": StepInput(np.full((1, 1, 1), dt)), **inputs}
    if scene.constraints is not None:
        if number != np.float64:
            raise SimulationError(
                f"dtype is {number}, expected float64 with constraints: rounding leaves 1e-7 of a dependent equation's "
                "pivot, as 3e-4 rad from a branch point do of an independent one's"
            )
        if scene.constraints.nc > recording.MOST_EQUATIONS:
            most = f"expected at most {recording.MOST_EQUATIONS} in a rollout; simulate takes more"
            raise SimulationError(f"constraints have {scene.constraints.nc} equations, {most}")
    held = held_by(scene, start[0], start[1], float(dt))
    if found is not None:
        inputs |= {name: StepInput(x[None, None]) for name, x in zip(found.inputs, found.values, strict=True)}
    if held is not None:
        inputs |= {name: StepInput(x) for name, x in held.values.items()}
    touch = touching(scene, kept, start[0], held)
    check_few(touch)
    extra: tuple[Argument, ...] = ()
    tables: tuple[Any, ...] = ()
    if touch is not None:
        extra, tables = touch.arguments, touch.tables
        inputs |= {x.name: StepInput(y[None, None]) for x, y in zip(touch.inputs, touch.values, strict=True)}
    if control is not None:
        inputs |= {name: StepInput(x) for name, x in control.rows(model, B, T).items()}
    own = carried_by(found.way if found else None, None if control is None else control.spec, (), extra)
    beside = carried(model, own, (*tables, *(() if control is None else control.static)), states, B)
    now = [np.ascontiguousarray(np.broadcast_to(x, (B, x.shape[1]))) for x in (*start, *beside.starts)]
    every = _every(1 if record is None else record, T)
    records = [np.empty((B, T // every, x.shape[1]), number) for x in now]
    if B and T and model.nv:
        rest = np.zeros(model.nv)
        calls["aba"](model, now[0][0], rest, rest)  # raises InertiaError naming the joint
        check_springs(model, method, now[0][0], float(dt))
        if model.nq != model.nv:
            calls["potential_energy"](model, now[0])  # raises ConfigurationError naming the joint
        _run(model, method, now, inputs, records, T, every, check, float(dt), held, found, control, touch, cost)
    single = np.ndim(q0) == 1 and np.ndim(v0) == 1 and not several
    single = single and all(len(x) == 1 for x in beside.starts)
    if isinstance(record, str):
        records = [x[:, -1] for x in records] if T else [x.copy() for x in now]
    t = np.array(T * dt) if isinstance(record, str) else dt * every * np.arange(1.0, T // every + 1.0)
    q, v, *after = [x[0] for x in records] if single else records
    touched = touch.record(q, after[0]) if touch is not None and touch.records else None
    return Rollout(
        q, v, t, model, beside.shown(np.concatenate(after, axis=-1)) if after else {}, touched, scene, method
    )


# --- arguments -------------------------------------------------------------------------------------------


def _choice(name: str, value: Any, known: dict[str, Any]) -> Any:
    if not isinstance(value, str) or value not in known:
        raise SimulationError(f"{name} is {value!r}, expected one of {', '.join(known)}")
    return known[value]


def _dtype(value: DTypeLike) -> np.dtype[Any]:
    try:
        name = np.dtype(value).name if isinstance(value, (str, type, np.dtype)) else repr(value)
    except (TypeError, ValueError, SyntaxError):
        name = str(value)
    return _choice("dtype", name, {x: np.dtype(x) for x in ("float64", "float32")})  # type: ignore[no-any-return]


def _is_number(x: Any) -> bool:
    """Whether x is one finite real number; arrays without axes pass."""
    single = isinstance(x, np.ndarray) and x.ndim == 0 and not masked(x)
    return math.isfinite(as_number(x[()] if single else x))


def _states(model: Model, q0: ArrayLike, v0: ArrayLike) -> list[Array]:
    found = []
    for name, value, columns in (("q0", q0, model.nq), ("v0", v0, model.nv)):
        x = as_array(name, value)
        if x.ndim not in (1, 2) or x.shape[-1] != columns:
            raise ShapeError(f"{name} has shape {x.shape}, expected (B, {columns}) or ({columns},)")
        found.append(np.atleast_2d(x))
    return found


def _law(model: Model, pd: PD) -> dict[str, tuple[Array, int]]:
    if not isinstance(pd, PD):
        raise SimulationError(f"pd is a {type(pd).__name__}, expected a PD(kp, kd, q_ref)")
    kp = as_array("pd.kp", pd.kp)
    if kp.shape[-1:] == (model.nv,):
        for joint in model.joints[1:]:
            if joint.nq != joint.nv and kp[..., joint.idx_v : joint.idx_v + joint.nv].any():
                what = f'joint "{joint.name}" ({joint.kind})'
                raise ModelError(f"pd.kp is not 0 for {what}, expected 0: its position is not one number")
            if joint.nq == joint.nv > 1 and kp[..., joint.idx_v : joint.idx_v + joint.nv].any():
                raise ModelError(f'pd.kp is not 0 for joint "{joint.name}" ({joint.kind}), expected 0: it is planar')
    v_ref = np.zeros(model.nv) if pd.v_ref is None else as_array("pd.v_ref", pd.v_ref)
    return {
        "kp": (kp, model.nv),
        "kd": (as_array("pd.kd", pd.kd), model.nv),
        "q_ref": (as_array("pd.q_ref", pd.q_ref), model.nq),
        "v_ref": (v_ref, model.nv),
    }


def _steps(steps: int | None, found: dict[str, int]) -> int:
    """T from the argument and from the axes of inputs, by name. Raises ShapeError if they differ."""
    if steps is not None and not (_is_number(steps) and math.isfinite(steps) and steps == int(steps) and steps >= 0):
        raise SimulationError(f"steps is {steps!r}, expected a whole number of 0 or more")
    several = {name: k for name, k in found.items() if k != 1}
    if steps is not None:
        several["argument steps"] = int(steps)
    numbers = list(several.values())
    if len(set(numbers)) > 1:
        listed = ", ".join(f"{name} {k}" for name, k in several.items())
        beside = "; an input of samples has an axis of steps too, which may be 1" if found else ""
        raise ShapeError(f"numbers of steps differ: {listed}, expected one{beside}")
    if not several and not found:
        raise SimulationError("steps is None, expected a whole number: no input has an axis of steps")
    return numbers[0] if numbers else 1


def _step_input(name: str, x: Array, shape: tuple[int, int, int]) -> StepInput:
    """An input as (samples or 1, steps or 1, columns)."""
    whole = x.reshape((1,) * (3 - x.ndim) + x.shape) if x.ndim <= 3 else x
    if (
        whole.ndim != 3
        or any(a not in (1, b) for a, b in zip(whole.shape[:2], shape[:2], strict=True))
        or (whole.shape[2] != shape[2])
    ):
        B, T, columns = shape
        wanted = f"({columns},), ({T}, {columns}) or ({B}, {T}, {columns})"
        raise ShapeError(f"{name} has shape {x.shape}, expected {wanted}")
    return StepInput(np.ascontiguousarray(whole))


def _of_contacts(record: Any) -> tuple[bool, Any]:
    """Whether "contacts" is among what is recorded, and the rest of the argument ``record``."""
    asked = [*record] if isinstance(record, (tuple, list)) else [record]
    rest = [x for x in asked if not (isinstance(x, str) and x == "contacts")]
    if not asked or len(rest) > 1:
        raise SimulationError(f'record is {record!r}, expected a number of steps or "last", "contacts", or both')
    return len(rest) < len(asked), rest[0] if rest else None


def _every(record: Any, steps: int) -> int:
    if isinstance(record, str) and record == "last":
        return max(1, steps)
    if isinstance(record, (int, np.integer)) and not isinstance(record, bool) and record >= 1:
        return min(int(record), steps + 1)  # more have no sample either
    raise SimulationError(f'record is {record!r}, expected a whole number of steps or "last"')


# --- the run ----------------------------------------------------------------------------------------------


@lru_cache(maxsize=32)
def _program(
    model: Model,
    method: str,
    law: bool,
    forced: bool,
    held: tuple[Argument, ...],
    way: str | None,
    coefficients: tuple[str, ...],
    control: Spec | None,
    held_law: bool,
    touch: tuple[Argument, ...],
    static: tuple[Any, ...],
) -> Program:
    specs = step_specs(method, law, forced, held, way, coefficients, control, held_law, (), touch)
    return recording.record(specs, model.bodies, static).program


def _holds(model: Model, q: Array, dtype: np.dtype) -> bool:
    """Whether the model's numbers, and the diagonal of M at q, are in the range of a dtype."""
    if dtype == np.float64:
        return True
    diagonal = np.diagonal(calls["crba"](model, q))
    return not float32_range.beyond(model.bodies) and bool(
        ((diagonal >= float32_range.LEAST) & (diagonal <= float32_range.MOST)).all()
    )


def _run(
    model: Model,
    method: str,
    states: list[Array],
    inputs: dict[str, StepInput],
    records: list[Array],
    steps: int,
    every: int,
    check: bool,
    dt: float,
    held: Held | None = None,
    found: Rubbing | None = None,
    control: Control | None = None,
    touch: Touching | None = None,
    cost: Cost | None = None,
) -> None:
    static: tuple[Any, ...]
    last, static = (held.inputs, (held.constraints.table,)) if held is not None else ((), ())
    kind = (method, "kp" in inputs, "tau" in inputs, last, *((found.way, found.inputs) if found else (None, ())))
    kind += (None, False) if control is None else (control.spec, control.held)
    extra: tuple[Argument, ...] = ()
    if touch is not None:
        extra, static = touch.arguments, static + touch.tables
    static += () if control is None else control.static
    specs, given = step_specs(*kind, (), extra), list(inputs.values())
    kind += (extra,)
    again = np.arange(len(states[0]))
    dtype = records[0].dtype
    if (
        not numba_kernels.PLAIN
        and recording.fits(specs, model.bodies, static=static)
        and _holds(model, states[0][0], dtype)
    ):
        kernel = step_kernel(specs, model, static, dtype, by_content=control is not None)
        if kernel is not None:
            with np.errstate(over="ignore"):
                start = [x.astype(dtype, copy=False) for x in states]
                forcing = [StepInput(x.rows.astype(dtype, copy=False)) for x in given]
            again = time_loop.run(kernel, start, forcing, records, steps, every)
    if len(again):
        _again(model, kind, static, held, states, inputs, records, again, steps, every, check, dt, touch, found, cost)
    if check and touch is not None and records[2].shape[1]:
        lost = samples_unsolved(touch, records[2][:, -1])
        if len(lost):
            reason = unsolved(touch, records[2][lost[0], -1], dt)
            raise SimulationError(f"sample {lost[0]}: {reason} ({len(lost)} samples in all); check=False lets it")
    if check and touch is None and found is not None and found.own is VIOLATION and records[2].shape[1]:
        beyond = records[2][:, :, 0] > UNSOLVED
        if beyond.any():
            samples = np.flatnonzero(beyond.any(axis=1))
            k = int(np.argmax(beyond[samples[0]]))
            raise SimulationError(
                f"friction of sample {samples[0]} violates Coulomb's law by {records[2][samples[0], k, 0]:.2g} rad/s "
                f"or m/s up to t = {(k + 1) * every * dt:.9g} s ({len(samples)} samples in all), expected at most "
                f"{UNSOLVED:g} of a solved step; check=False lets it"
            )


def _again(
    model: Model,
    kind: tuple[Any, ...],
    static: tuple[Any, ...],
    held: Held | None,
    states: list[Array],
    inputs: dict[str, StepInput],
    records: list[Array],
    again: Array,
    steps: int,
    every: int,
    check: bool,
    dt: float,
    touch: Touching | None = None,
    found: Rubbing | None = None,
    cost: Cost | None = None,
) -> None:
    """Run some samples through all steps by the program in NumPy. The sum of a cost is the last of the states."""
    # samples the lanes leave undone: angles beyond the short sine's range, states not finite, masses beyond float32
    program = _program(model, *kind, static)
    lost, reason = np.full(len(again), -1), ""
    of_cost = np.zeros(len(again), np.bool_)  # whether the cost alone is not finite
    now = [x[again] for x in states]
    rows = [np.broadcast_to(x.rows, (len(states[0]), *x.rows.shape[1:])) for x in inputs.values()]
    for k in range(steps):
        columns = [x for s in now for x in s.T]
        for x in rows:
            columns += list(x[again, min(k, x.shape[1] - 1)].T)
        with np.errstate(all="ignore"):
            results = [np.broadcast_to(np.asarray(x, np.float64), len(again)) for x in program.run(columns)]
        before = now
        ends = np.cumsum([0, *(s.shape[1] for s in now)])
        now = [np.stack(results[a:b], 1) for a, b in pairwise(ends)]
        finite = np.logical_and.accumulate([np.isfinite(s).all(1) for s in now])
        just = np.flatnonzero((lost < 0) & ~finite[-1])
        of_cost[just] = cost is not None and finite[-2, just]
        if held is not None and check and len(just) and not reason:
            at = again[just[0]]
            acting = {name: x[at, min(k, x.shape[1] - 1)] for name, x in zip(inputs, rows, strict=True)}
            now_at = [x[just[0]] for x in before]
            reason = _reason(model, kind[0], held, now_at, acting, int(at), touch, found)
        lost[just] = k
        if (k + 1) % every == 0:
            for r, x in zip(records, now, strict=True):
                with np.errstate(over="ignore"):
                    r[again, (k + 1) // every - 1] = x
    if check and (lost >= 0).any():
        first = int(np.flatnonzero(lost >= 0)[0])
        if reason:
            earliest = int(np.flatnonzero(lost == lost[lost >= 0].min())[0])
            when = f"sample {int(again[earliest])}, step from t = {lost[earliest] * dt:.9g} s"
            raise SimulationError(f"{when}: {reason}")
        if cost is not None and of_cost[first]:
            raise SimulationError(
                f"cost of sample {int(again[first])} is not finite in the step from t = {lost[first] * dt:.9g} s "
                f'({int((lost >= 0).sum())} samples in all), expected finite numbers of spec "{cost.spec.name}"'
            )
        raise SimulationError(
            f"state of sample {int(again[first])} is not finite after t = {(lost[first] + 1) * dt:.9g} s "
            f"({int((lost >= 0).sum())} samples in all), expected finite inputs and a smaller dt"
        )


def _reason(
    model: Model, method: str, held: Held, state: list[Array], forcing: dict[str, Array], sample: int,
    touch: Touching | None = None, found: Rubbing | None = None,
) -> str:  # fmt: skip
    """What is wrong with a step under constraints, "" if its state is merely not finite: the step is taken by calls."""
    (q, v), n = (x.copy() for x in state[:2]), model.nv
    tau = forcing.get("tau", np.zeros(n)).copy()
    if "kp" in forcing:
        tau = with_pd(table(model.bodies), q, v, forcing, tau)
    own = held._replace(rank=held.rank[sample : sample + 1] if len(held.rank) > 1 else held.rank)
    kernels = explicit.kernels_of(accelerate(own, model))
    rows, h = getattr(model, numba_kernels.TABLE), float(forcing["dt"][0])
    system = System(kernels, held_torque, None, rows, None, None, None, None, tau, np.zeros(3))
    space = State(q, v, v, q.copy(), None, np.zeros((10, n)))
    try:
        with np.errstate(all="ignore"):
            if touch is None:
                projected(EXPLICIT_METHODS[method], own, model)(system, 0.0, h, space)
            else:
                before = dict(zip([touch.own.name, BRISTLES.name], state[2:], strict=False))
                solver(touch, None, found, own, has_springs(model), once=True)(system, 0.0, h, space, before)
    except ConstraintError as error:
        return str(error)
    return ""
