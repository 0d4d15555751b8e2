"""Many simulations at once: the methods of ``explicit`` traced into one program, which lanes run step after step.

A step of a method is recorded as any recursion is, on numbers that write down what is done to them; the loop over the
steps runs inside compiled code, a register full of samples at a time, their states in the first cache.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache, lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from ..bodies.table import PRISMATIC, REVOLUTE
from ..calls.arguments import as_array, as_flag, as_number, broadcast, check_model
from ..calls.dynamics import calls
from ..engines.compiled import numba_kernels
from ..engines.programs import batch_kernels, float32_range, time_loop
from ..engines.programs.time_loop import Driven
from ..engines.programs.tracer import Program, scratch
from ..errors import ModelError, ShapeError, SimulationError
from ..model.model import Model
from ..model.robot import masked
from ..recursions.aba import WORK, aba
from ..recursions.configuration import integrate
from ..recursions.spec import TAU, Argument, Q, Spec, V
from . import explicit
from .system import OK, State, System, held_torque

Array = NDArray[Any]
METHODS: dict[str, Callable[..., None]] = {
    "explicit_euler": explicit.explicit_euler,
    "semi_implicit_euler": explicit.semi_implicit_euler,
    "velocity_verlet": explicit.velocity_verlet,
    "rk4": explicit.rk4,
}
DT = Argument("dt", (), "s", "step")
LAW = (
    Argument("kp", ("nv",), "N m/rad | N/m", "gains of position"),
    Argument("kd", ("nv",), "N m s/rad | N s/m", "gains of velocity"),
    Argument("q_ref", ("nq",), "rad | m", "positions to reach"),
    Argument("v_ref", ("nv",), "rad/s | m/s", "velocities to reach"),
)


class PD(NamedTuple):
    """A joint-space law: tau = kp (q_ref - q) + kd (v_ref - v) + what ``rollout`` is given as tau.

    kp, kd  (nv,) or (B, 1, nv), of samples of their own  gains [N m/rad | N/m], [N m s/rad | N s/m]
    q_ref   (nq,), (T, nq) or (B, T, nq)  positions to reach [rad | m]
    v_ref   (nv,), (T, nv) or (B, T, nv)  velocities to reach [rad/s | m/s]; zero if left out

    It is evaluated at the beginning of a step and held over it, as a digital controller does. Joints whose position
    is no single number (quaternions, planar, cos and sin) have no q_ref - q: their kp has to be 0.
    """

    kp: ArrayLike
    kd: ArrayLike
    q_ref: ArrayLike
    v_ref: ArrayLike | None = None


class Rollout(NamedTuple):
    """States of a rollout: q (B, T, nq) and v (B, T, nv) after each recorded step; no axis T if only the last is."""

    q: Array
    v: Array


def rollout(
    model: Model,
    q0: ArrayLike,
    v0: ArrayLike,
    tau: ArrayLike | None = None,
    *,
    dt: float,
    steps: int | None = None,
    method: str = "semi_implicit_euler",
    pd: PD | None = None,
    record: int | str = 1,
    dtype: DTypeLike = np.float64,
    check: bool = True,
) -> Rollout:
    """Simulate a batch of states over as many steps, all of it in compiled code.

    q0      (B, nq) or (nq,)  positions at the beginning [rad | m]
    v0      (B, nv) or (nv,)  velocities [rad/s | m/s]
    tau     (nv,), (T, nv) or (B, T, nv)  torques, held over each step [N m | N]; zero if left out
    dt      step [s]
    steps   T, if neither tau nor pd has an axis that says it
    method  "semi_implicit_euler", "explicit_euler", "velocity_verlet" or "rk4", as in ``simulate``
    pd      a law of the joints that is added to tau
    record  1 for the state after every step, k after every k-th, "last" for the last alone (of no steps, the first)
    dtype   float64, or float32: faster, and exact to some 1e-6 a step; numbers below its range, 1e-38, count as 0, and
            robots whose inertias are beyond 1e-18 to 1e18 (kg, kg m²) are computed in float64
    check   whether a state that leaves the numbers is an error; if not, it is NaN from there on

    The first use for a model, method and kind of input compiles a program (0.1 s to a few seconds), which is kept.
    Damping, friction and limits of the joints act nowhere; there are no contacts.

    Returns a Rollout (q, v).
    Raises
        ShapeError for sizes that do not fit
        SimulationError for dt, steps, record, dtype or a method that is none, and for a state that is not finite any
            more, naming the sample and the time
        InertiaError naming a joint that moves no inertia
        ConfigurationError naming a joint whose quaternion or (cos, sin) is not of norm 1 within 1e-6
        ModelError for a model with mimic joints, or gains where no position is a number
        KeyboardInterrupt at Ctrl-C, which is heard between slices of samples and steps; no bit depends on them

    >>> import numpy as np, spatialdyn as sd
    >>> model = sd.load_urdf("two_link")
    >>> hold = sd.PD(kp=[40.0, 40.0], kd=[8.0, 8.0], q_ref=[0.5, 0.0])
    >>> q, v = sd.rollout(model, np.zeros((100, 2)), np.zeros((100, 2)), dt=1e-3, steps=500, pd=hold)
    >>> q.shape
    (100, 500, 2)
    """
    if check_model(model).mimic_matrix is not None:
        raise ModelError(f'model "{model.name}" has mimic joints, expected one without (mimic=False)')
    _choice("method", method, METHODS)
    number, check = _dtype(dtype), as_flag("check", check)
    if not (_is_number(dt) and math.isfinite(dt) and dt > 0.0):
        raise SimulationError(f"dt is {dt!r}, expected a positive number of seconds")
    driving = {} if tau is None else {"tau": (as_array("tau", tau), model.nv)}
    if pd is not None:
        driving |= _law(model, pd)
    states, axes = _states(model, q0, v0), [x.shape[:-1] for x, _ in driving.values()]
    several = {name: x.shape[:1] for name, (x, _) in driving.items() if x.ndim == 3}
    (B,) = broadcast(["q0", "v0", *several], [states[0].shape[:1], states[1].shape[:1], *several.values()])
    T = _steps(steps, [lead[-1] for lead in axes if lead])
    states = [np.ascontiguousarray(np.broadcast_to(x, (B, x.shape[1]))) for x in states]
    inputs = {name: _driven(name, x, (B, T, columns)) for name, (x, columns) in driving.items()}
    inputs = {"dt": Driven(np.full((1, 1, 1), dt)), **inputs}
    every = _every(record, T)
    records = [np.empty((B, T // every, x.shape[1]), number) for x in states]
    if B and T and model.nv:
        rest = np.zeros(model.nv)
        calls["aba"](model, states[0][0], rest, rest)  # which names a joint that moves no inertia
        if model.nq != model.nv:
            calls["potential_energy"](model, states[0])  # which names a quaternion that is none
        _run(model, method, states, inputs, records, T, every, check, float(dt))
    q, v = records
    single = np.ndim(q0) == 1 and np.ndim(v0) == 1 and not any(len(lead) == 2 for lead in axes)
    if isinstance(record, str):
        q, v = (q[:, -1], v[:, -1]) if T else (x.copy() for x in states)
    return Rollout(q[0], v[0]) if single else Rollout(q, v)


# --- reading what is asked for ---------------------------------------------------------------------------


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
    """Whether it is one finite real number; arrays without axes pass."""
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
                raise ModelError(
                    f'pd.kp is not 0 for joint "{joint.name}" ({joint.kind}), expected 0: its position is no number'
                )
            if joint.nq == joint.nv > 1 and kp[..., joint.idx_v : joint.idx_v + joint.nv].any():
                raise ModelError(f'pd.kp is not 0 for joint "{joint.name}" ({joint.kind}), expected 0: it is planar')
    v_ref = np.zeros(model.nv) if pd.v_ref is None else as_array("pd.v_ref", pd.v_ref)
    return {
        "kp": (kp, model.nv),
        "kd": (as_array("pd.kd", pd.kd), model.nv),
        "q_ref": (as_array("pd.q_ref", pd.q_ref), model.nq),
        "v_ref": (v_ref, model.nv),
    }


def _steps(steps: int | None, found: list[int]) -> int:
    """How many there are, from what is said and from the axes of inputs."""
    if steps is not None and not (_is_number(steps) and math.isfinite(steps) and steps == int(steps) and steps >= 0):
        raise SimulationError(f"steps is {steps!r}, expected a whole number of 0 or more")
    several = {k for k in found if k != 1} | ({int(steps)} if steps is not None else set())
    if len(several) > 1:
        raise ShapeError(f"inputs and steps say {sorted(several)} steps, expected one number of them")
    if not several and not found:
        raise SimulationError("steps is None, expected a whole number: no input has an axis that says it")
    return several.pop() if several else 1


def _driven(name: str, x: Array, shape: tuple[int, int, int]) -> Driven:
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
    return Driven(np.ascontiguousarray(whole))


def _every(record: int | str, steps: int) -> int:
    if isinstance(record, str) and record == "last":
        return max(1, steps)
    if isinstance(record, (int, np.integer)) and not isinstance(record, bool) and record >= 1:
        return int(record)
    raise SimulationError(f'record is {record!r}, expected a whole number of steps or "last"')


# --- a step as a program ---------------------------------------------------------------------------------


class _Kernels(NamedTuple):
    """What the methods call, on rows of a table: the recursions themselves."""

    accelerate: Callable[..., int]
    integrate: Callable[..., int]
    displacement_rate: Callable[..., int]


def _accelerate(system: System, q: Any, v: Any, a: Any) -> int:
    n = len(a)
    aba(system.table, scratch(WORK, n + 1), q, v, system.tau, None, a, np.zeros(n, object))
    return OK


def _integrate(rows: Any, q: Any, v: Any, out: Any) -> int:
    integrate(rows, q, v, out)
    return OK


def _displacement_rate(rows: Any, u: Any, v: Any, out: Any) -> int:
    explicit.rate_of_displacement(rows, u, v, out)
    return OK


@cache
def step_specs(method: str, law: bool, driven: bool) -> tuple[Spec, Spec]:
    """The positions and the velocities after a step, as calls of the states, dt and what drives them."""

    def after(rows: Any, inputs: dict[str, Any]) -> State:
        q, v = inputs["q"].copy(), inputs["v"].copy()
        tau = inputs["tau"].copy() if driven else np.zeros(len(v), object)
        if law:
            error = np.zeros(len(v), object)
            for i, row in enumerate(rows[1:]):
                if row.dofs == 1 and row.kind in (REVOLUTE, PRISMATIC):
                    error[i] = inputs["q_ref"][row.at] - q[row.at]
            tau = tau + inputs["kp"] * error + inputs["kd"] * (inputs["v_ref"] - v)
        system = System(
            _Kernels(_accelerate, _integrate, _displacement_rate),
            held_torque,
            None,
            rows,
            None,
            None,
            None,
            None,
            tau,
            None,
        )
        state = State(q, v, v, q.copy(), None, np.zeros((10, len(v)), object))
        METHODS[method](system, 0.0, inputs["dt"], state)
        return state

    names = ["q", "v", "dt", *(["tau"] if driven else []), *(x.name for x in (LAW if law else ()))]
    given = (Q, V, DT, *((TAU,) if driven else ()), *(LAW if law else ()))

    def positions(rows: Any, *arrays: Any) -> None:
        arrays[-1][:] = after(rows, dict(zip(names, arrays, strict=False))).q

    def velocities(rows: Any, *arrays: Any) -> None:
        arrays[-1][:] = after(rows, dict(zip(names, arrays, strict=False))).w

    summary, source = "A step of a rollout.", "see explicit"
    q_after, v_after = Argument("q_after", ("nq",), "rad | m", "positions"), Argument("v_after", ("nv",), "rad/s", "")
    return (
        Spec(f"rollout_{method}_q", positions, None, given, q_after, summary, source, regroup=True),
        Spec(f"rollout_{method}_v", velocities, None, given, v_after, summary, source, regroup=True),
    )


@lru_cache(maxsize=32)
def _program(model: Model, method: str, law: bool, driven: bool) -> Program:
    return batch_kernels.record(step_specs(method, law, driven), model.bodies).program


def _holds(model: Model, q: Array, dtype: np.dtype) -> bool:
    """Whether the numbers of the model, and the diagonal of M in a state, are in the range of a dtype."""
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
    inputs: dict[str, Driven],
    records: list[Array],
    steps: int,
    every: int,
    check: bool,
    dt: float,
) -> None:
    law, driven = "kp" in inputs, "tau" in inputs
    specs, given = step_specs(method, law, driven), list(inputs.values())
    again = np.arange(len(states[0]))
    dtype = records[0].dtype
    if not numba_kernels.PLAIN and batch_kernels.fits(specs, model.bodies) and _holds(model, states[0][0], dtype):
        kernel = batch_kernels.kernel(specs, model.bodies, model.key, dtype=dtype)
        if kernel is not None:
            with np.errstate(over="ignore"):
                start = [x.astype(dtype, copy=False) for x in states]
                driving = [Driven(x.rows.astype(dtype, copy=False)) for x in given]
            again = time_loop.run(kernel, start, driving, records, steps, every)
    if not len(again):
        return
    # what lanes leave: angles beyond the short sine's range, states that are not finite, masses beyond float32's range
    program = _program(model, method, law, driven)
    lost = np.full(len(again), -1)
    now = [x[again] for x in states]
    rows = [np.broadcast_to(x.rows, (len(states[0]), *x.rows.shape[1:])) for x in given]
    for k in range(steps):
        columns = [x for s in now for x in s.T]
        for x in rows:
            columns += list(x[again, min(k, x.shape[1] - 1)].T)
        results = [np.broadcast_to(np.asarray(x, np.float64), len(again)) for x in program.run(columns)]
        now = [np.stack(results[: now[0].shape[1]], 1), np.stack(results[now[0].shape[1] :], 1)]
        finite = np.isfinite(now[0]).all(1) & np.isfinite(now[1]).all(1)
        lost[(lost < 0) & ~finite] = k
        if (k + 1) % every == 0:
            for r, x in zip(records, now, strict=True):
                with np.errstate(over="ignore"):
                    r[again, (k + 1) // every - 1] = x
    if check and (lost >= 0).any():
        first = int(np.flatnonzero(lost >= 0)[0])
        raise SimulationError(
            f"state of sample {int(again[first])} is not finite after t = {(lost[first] + 1) * dt:.9g} s "
            f"({int((lost >= 0).sum())} samples in all), expected finite inputs and a smaller dt"
        )
