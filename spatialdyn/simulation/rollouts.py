"""Many simulations at once: a step of a method of ``explicit`` is recorded as a program, which runs on SIMD lanes.

The loop over the steps is compiled too: it takes one register of samples after another through all steps, with their
states in the first-level cache.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from ..calls.arguments import as_array, as_flag, as_number, as_word, broadcast
from ..calls.devices import as_device
from ..calls.dynamics import calls
from ..control.control import Control, check_control
from ..control.cost import Cost, check_cost, with_cost
from ..errors import NonFiniteError, ShapeError, SimulationError, literal
from ..model.model import Model
from ..model.robot_checks import masked
from .driver import run_samples
from .effects.control import Feedback, check_law
from .methods.methods import SCIPY_METHODS
from .plan import Inputs, method_of, plan_of
from .rollout_result import Rollout
from .scene import Scene, effects_in_scene, scene_of, warn_of_friction
from .stable_steps import check_smooth_friction, check_springs
from .states import run_states
from .stiff_laws import warn_of_stiff_law

Array = NDArray[Any]
MOST_STEPS = 1 << 53  # and bytes of a record; a compiled loop counts to 2^63


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
    record: int | str | Sequence[int | str] | None = None,
    dtype: DTypeLike = np.float64,
    check: bool = True,
    control: Control | None = None,
    states: Mapping[str, ArrayLike] | None = None,
    cost: Cost | None = None,
    fext: ArrayLike | None = None,
    device: str = "cpu",
) -> Rollout:
    """Simulate a batch of states over many steps in compiled code.

    scene   Scene: the robot and what acts on it; a Model is a scene on which nothing else acts
    q0      (B, nq) or (nq,)  positions at the beginning [rad | m]
    v0      (B, nv) or (nv,)  velocities [rad/s | m/s]
    tau     (nv,), (T, nv) or (B, T, nv)  torques, held over each step [N m | N]; zero if left out
    dt      step [s]
    steps   T; needed if neither tau nor a value of control has an axis T
    method  "semi_implicit_euler", which takes every scene, or another of ``scene.methods``, as in ``simulate``; None
            for ``scene.method``. Methods with adaptive steps, and methods in momenta if more acts than torques and
            ``fext``, run one sample after another
    record  1 for the state after every step, k for every k-th, "last" for the last alone (with no steps, the first);
            by default 1, or "last" with a cost. "contacts", or (k, "contacts"), records impulses, gaps and residuals
    dtype   float64, or float32: faster, with errors of some 1e-6 a step; numbers below its range, 1e-38, are flushed to
            0, and robots with inertias outside 1e-18 to 1e18 (kg, kg m²) are computed in float64
    check   whether states that are not finite, and friction or contacts that are not solved, are errors; if not, such
            states are returned. Also whether to warn of a law of the library that is too stiff for dt, as ``simulate``
    control  a Control, whose torque is added to tau; its values may have axes of samples and steps
    states   {name: (B, ...) or (...)}  initial states beside q and v, those of the control law and "bristles"; states
             left out start with the values in their Spec
    cost     a Cost, summed over the steps: ``run.cost`` (B,). By default only the last state is then recorded; with
             ``record`` the partial sums are recorded too
    fext     (T, njoints, 6) or (B, T or 1, njoints, 6)  external forces that vary, held over each step, in addition to
             those of the scene; on each joint's body, in the joint's frame [N | N m]

    device   "cuda": q0, v0, tau and fext are arrays of PyTorch, CuPy or JAX on a GPU, of this dtype, and so are the
             arrays of the Rollout; each thread runs a sample, with the bits of lanes. For methods and scenes that run
             on lanes

    Samples run side by side on SIMD lanes. In scenes with more than 36 equations of constraints, 12 contact points, or,
    with dry joints or constraints beside the contacts, 36 impulses (three per point, one per joint), one sample runs
    after another. Constraints need float64. Coefficients of friction and contacts are inputs of the program: changing
    them compiles nothing.
    The first use for a model, method and kind of input compiles a program (0.1 s to a few seconds) and caches it.

    Returns a Rollout, which unpacks as (q, v).
    Raises
        ShapeError for shapes that do not match
        SimulationError for an invalid dt, steps, record, dtype or method, and for a state or cost that is not finite,
            naming the sample and the time; for friction as ``simulate``; with check, if friction or a contact violates
            Coulomb's law by more than 0.01 rad/s or m/s, naming sample, time and point
        TypeError naming the Spec of a law or cost that cannot be recorded
        InertiaError naming a joint with zero articulated inertia
        ConfigurationError naming a joint whose quaternion or (cos, sin) is not of norm 1 within 1e-6
        ConstraintError for a start that violates the constraints; SimulationError naming sample, time and constraints
            if constraints contradict each other or their rank changes
        KeyboardInterrupt at Ctrl-C, checked between slices of samples and steps; no bit depends on the slices

    >>> import numpy as np, spatialdyn as sd
    >>> model = sd.load_urdf("two_link")
    >>> hold = sd.PD(kp=[40.0, 40.0], kd=[8.0, 8.0], q_ref=[0.5, 0.0])
    >>> q, v = sd.rollout(model, np.zeros((100, 2)), np.zeros((100, 2)), dt=1e-3, steps=500, control=hold)
    >>> q.shape
    (100, 500, 2)
    """
    scene, where = scene_of(scene), as_device(device)
    model = scene.model
    method = method_of(scene, method).name
    warn_of_friction(scene, "rollout")
    number, check = _dtype(dtype), as_flag("check", check)
    if not (_is_number(dt) and math.isfinite(dt) and dt > 0.0):
        raise SimulationError(f"dt is {literal(dt)}, expected a positive number of seconds")
    check_smooth_friction(scene, method, float(dt))
    check_control(control)
    kept, record = _of_contacts(record)
    if cost is not None:
        control, record = with_cost(control, check_cost(cost)), "last" if record is None else record
    check_law(control, method)
    given = None
    if where is not None:
        from .device_runs import DeviceInputs, check_on_device

        given = DeviceInputs(where, number, {"q0": q0, "v0": v0, "tau": tau, "fext": fext})
        q0, v0, tau, fext = given.on_host()
    start, (B, T), (tau_rows, fext_rows) = _inputs(model, q0, v0, (tau, fext), control, steps, given is None)
    single = _is_single(q0, v0, tau, fext, control)
    _check_lanes(scene, number)
    fixed = 0.0 if method in SCIPY_METHODS else float(dt)
    feedback = None if control is None else Feedback.of(control, model, B, T)
    forces = (
        fext_rows if given is None or fext_rows is None else fext_rows[:1, :1]
    )  # zeros in place of the inputs that are given
    plan = plan_of(scene, method, (start[0], start[1]), fixed, False, kept, Inputs(forces, None, feedback))
    initial = plan.unstarted if states is None else run_states(model, plan.states, plan.tables, states, B)
    now = [np.ascontiguousarray(np.broadcast_to(x, (B, x.shape[1]))) for x in (*start, *initial.starts)]
    every = _every(1 if record is None else record, T)
    if 8 * B * (T // every) * sum(x.shape[1] for x in now) >= MOST_STEPS:
        raise SimulationError(f"{B} samples of {T // every} states are more than memory holds, expected fewer")
    if given is not None:
        check_on_device(plan, now[0], number, kept)
    if B and T and model.nv:
        rest = np.zeros(model.nv)
        calls["aba"](model, now[0][0], rest, rest)  # raises InertiaError naming the joint
        check_springs(scene, method, now[0][0], float(dt))
        if model.nq != model.nv:
            calls["potential_energy"](model, now[0])  # raises ConfigurationError naming the joint
        if check and control is not None:
            warn_of_stiff_law(plan, control, (now[0][0], now[1][0]), tau_rows, float(dt))
    if given is not None:
        ways = [(1, 1) if x is None else x.shape[:2] for x in (tau_rows, fext_rows)]
        records = given.run(plan, initial, now, ways, (float(dt), T, every), check)
        now = [given.library.upload(x.astype(number)) for x in now] if not T else now
    else:
        records = [np.empty((B, T // every, x.shape[1]), number) for x in now]
        if B and T and model.nv:
            run_samples(plan, initial, now, tau_rows, records, (float(dt), T, every), check)
    single = single and all(len(x) == 1 for x in initial.starts)
    if isinstance(record, str):
        records = [x[:, -1] for x in records] if T else [*now] if given is not None else [x.copy() for x in now]
    t = np.array(T * dt) if isinstance(record, str) else dt * every * np.arange(1.0, T // every + 1.0)
    q, v, *after = [x[0] for x in records] if single else records
    contact, impulses = plan.contact, None
    if contact is not None and contact.records:
        impulses = contact.record(q, after[[x.name for x in plan.states].index(contact.own.name)])
    shown = initial.named(after)
    return Rollout(q, v, t, model, shown, impulses, scene, method)


# --- arguments -------------------------------------------------------------------------------------------


def _dtype(value: DTypeLike) -> np.dtype[Any]:
    try:
        name = np.dtype(value).name if isinstance(value, (str, type, np.dtype)) else literal(value)
    except (TypeError, ValueError, SyntaxError):
        name = value if isinstance(value, str) else literal(value)
    return np.dtype(as_word("dtype", name, ("float64", "float32"), SimulationError))


def _is_number(x: Any) -> bool:
    """Whether x is one finite real number; arrays without axes pass."""
    single = isinstance(x, np.ndarray) and x.ndim == 0 and not masked(x)
    return math.isfinite(as_number(x[()] if single else x))


def _states(model: Model, q0: ArrayLike, v0: ArrayLike) -> list[Array]:
    states = []
    for name, value, columns in (("q0", q0, model.nq), ("v0", v0, model.nv)):
        x = as_array(name, value)
        if x.ndim not in (1, 2) or x.shape[-1] != columns:
            raise ShapeError(f"{name} has shape {x.shape}, expected (B, {columns}) or ({columns},)")
        states.append(np.atleast_2d(x))
    return states


def _inputs(
    model: Model, q0: ArrayLike, v0: ArrayLike, given: tuple[Any, Any], control: Control | None, steps: int | None,
    on_host: bool,
) -> tuple[list[Array], tuple[int, int], tuple[Array | None, Array | None]]:  # fmt: skip
    """States at the beginning; numbers of samples and steps; rows of tau and fext. Raises ShapeError.

    on_host  whether tau and fext have memory: if not, they are zeros of the shapes of those on a device
    """
    tau, fext = given
    arrays: dict[str, tuple[Array, tuple[int, ...]]] = (
        {} if tau is None else {"tau": (as_array("tau", tau), (model.nv,))}
    )
    if fext is not None:
        x = as_array("fext", fext)
        if x.shape == (model.njoints, 6):
            raise SimulationError("fext is constant, an option of the scene, expected sd.Scene(model, fext=fext)")
        if on_host and not np.isfinite(x).all():
            raise NonFiniteError("fext has numbers that are not finite, expected finite ones")
        arrays["fext"] = x, (model.njoints, 6)
    start = _states(model, q0, v0)
    axes = {name: x.shape[: max(0, x.ndim - len(core))] for name, (x, core) in arrays.items()}
    if control is not None:
        axes |= control.axes(model)
    several = {name: lead[:1] for name, lead in axes.items() if len(lead) == 2}
    (B,) = broadcast(["q0", "v0", *several], [start[0].shape[:1], start[1].shape[:1], *several.values()])
    T = _steps(steps, {name: lead[-1] for name, lead in axes.items() if lead})
    rows = {name: x.reshape(_shape_of_rows(name, x, core, B, T)) for name, (x, core) in arrays.items()}
    rows = {name: np.ascontiguousarray(x) if on_host else x for name, x in rows.items()}
    torques, forces = rows.pop("tau", None), rows.pop("fext", None)
    forces = None if forces is None else forces.reshape((*forces.shape[:2], model.njoints, 6))
    return start, (B, T), (torques, forces)


def _is_single(q0: Any, v0: Any, tau: Any, fext: Any, control: Control | None) -> bool:
    """Whether no argument has an axis of samples."""
    parts = [(q0, 1), (v0, 1), (tau, 2), (fext, 3)]
    return not (control is not None and control.batched) and all(x is None or np.ndim(x) <= most for x, most in parts)


def _check_lanes(scene: Scene, number: np.dtype[Any]) -> None:
    """Raise SimulationError for float32 with constraints."""
    if scene.constraints is not None and number != np.float64:
        raise SimulationError(
            f"dtype is {number}, expected float64 with constraints: rounding leaves 1e-7 of a dependent equation's "
            "pivot, as 3e-4 rad from a branch point do of an independent one's"
        )


def _steps(steps: int | None, lengths: dict[str, int]) -> int:
    """T from the argument ``steps`` and the axes of inputs, by name. Raises ShapeError if they differ."""
    if steps is not None and _is_number(steps) and steps >= MOST_STEPS:
        raise SimulationError(f"steps is {literal(steps)}, expected fewer than 2^53")
    if steps is not None and not (_is_number(steps) and math.isfinite(steps) and steps == int(steps) and steps >= 0):
        raise SimulationError(f"steps is {literal(steps)}, expected a whole number of 0 or more")
    several = {name: k for name, k in lengths.items() if k != 1}
    if steps is not None:
        several["argument steps"] = int(steps)
    numbers = list(several.values())
    if len(set(numbers)) > 1:
        listed = ", ".join(f"{name} {k}" for name, k in several.items())
        hint = "; an input of samples has an axis of steps too, which may be 1" if lengths else ""
        raise ShapeError(f"numbers of steps differ: {listed}, expected one{hint}")
    if not several and not lengths:
        raise SimulationError("steps is None, expected a whole number: no input has an axis of steps")
    return numbers[0] if numbers else 1


def _shape_of_rows(name: str, x: Array, core: tuple[int, ...], B: int, T: int) -> tuple[int, ...]:
    """(samples or 1, steps or 1, columns) of an input. Raises ShapeError."""
    lead = x.shape[: max(0, x.ndim - len(core))]
    fits = len(lead) <= 2 and x.shape[len(lead) :] == core
    whole = (1,) * (2 - len(lead)) + lead
    if not fits or any(a not in (1, b) for a, b in zip(whole, (B, T), strict=True)):
        wanted = f"{core}, {(T, *core)} or {(B, T, *core)}" if len(core) == 1 else f"{(T, *core)} or {(B, T, *core)}"
        raise ShapeError(f"{name} has shape {x.shape}, expected {wanted}")
    return (*whole, math.prod(core))


def _of_contacts(record: Any) -> tuple[bool, Any]:
    """Whether ``record`` contains "contacts", and the rest of this argument."""
    asked = [*record] if isinstance(record, (tuple, list)) else [record]
    rest = [x for x in asked if not (isinstance(x, str) and x == "contacts")]
    if not asked or len(rest) > 1:
        raise SimulationError(f'record is {literal(record)}, expected a number of steps or "last", "contacts", or both')
    return len(rest) < len(asked), rest[0] if rest else None


def _every(record: Any, steps: int) -> int:
    if isinstance(record, str) and record == "last":
        return max(1, steps)
    if isinstance(record, (int, np.integer)) and not isinstance(record, bool) and record >= 1:
        return min(int(record), steps + 1)  # a larger one records no further sample
    raise SimulationError(f'record is {literal(record)}, expected a whole number of steps or "last"')
