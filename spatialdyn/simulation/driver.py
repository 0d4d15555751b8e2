"""Runs of many samples: one program takes them side by side; samples that it rejects run as in ``simulate``.

Whether there is a program depends on the robot, the effects, the method and the kind of torque, never on the number of
steps or samples: if there is one, it runs from the first step on, with the same bits for one sample and for many. From
the first step that it rejects (an angle beyond its range, a state that is not finite) the recursions run: a few steps
in plain Python, then table kernels.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..calls.dynamics import calls
from ..control.cost import is_of_cost
from ..control.law_specs import own_name
from ..engines.compiled import numba_kernels
from ..engines.programs.run import time_loop
from ..engines.programs.run.time_loop import StepInput
from ..engines.programs.transform import float32_range
from ..errors import SimulationError, SpatialDynError
from ..model.model import Model
from .fixed_steps import run_sample
from .methods.methods import EXPLICIT_METHODS
from .momenta_steps import begun
from .plan import Plan
from .recorder import Recorder, Steps
from .states import RunStates
from .torques import Torque

Array = NDArray[Any]


def run_samples(
    plan: Plan, initial: RunStates, states: Sequence[Array], tau: Array | None, records: Sequence[Array],
    steps: tuple[float, int, int], check: bool,
) -> None:  # fmt: skip
    """Run samples from their states q, v and the initial states of effects; write records (samples, records, columns).

    tau    (samples or 1, steps or 1, nv)  None for zero
    steps  dt, the number of steps, and the steps per record
    check  whether a sample that fails is an error; if not, its records are NaN from there on

    Raises SimulationError naming the sample.
    """
    dt, _, every = steps
    left, several = on_lanes(plan, states, tau, records, steps), ""
    if left is None:
        left = np.arange(len(states[0]))
    elif (bad := sum(not all(np.isfinite(x[b]).all() for x in records) for b in left)) > 1:
        several = f" ({bad} samples in all); check=False lets it"
    for b in left:
        start, rows = [x[b].astype(float) for x in states], [x[b] for x in records]
        held = np.zeros((1, plan.model.nv)) if tau is None else tau[min(b, len(tau) - 1)].astype(float)
        reason = run_alone(plan, initial, start, held, rows, steps, b, check)
        if reason and check:
            raise SimulationError(f"sample {b}: {reason}{several}")
    if check and plan.judged and records[0].shape[1]:
        check_solved(plan, records, dt, every)


def run_alone(
    plan: Plan, initial: RunStates, start: list[Array], held: Array, rows: Sequence[Array],
    steps: tuple[float, int, int], sample: int, check: bool,
) -> str:  # fmt: skip
    """Run a sample as ``simulate`` does, from its start and torques (steps or 1, nv), and write its records. Returns
    the reason of a failure, "" without one. With ``check``, a start that is not finite is not run.
    """
    reason = _not_finite(plan, start, held, steps[0]) or _value_not_finite(plan, sample)
    if reason and check:
        return reason
    return _alone(plan, initial, start, held, rows, steps, sample)


def _not_finite(plan: Plan, state: Sequence[Array], held: Array, dt: float) -> str:
    """Which part of a sample's start and torques (steps or 1, nv) is not finite; "" if all are finite."""
    for name, x in zip(("q0", "v0", *(x.name for x in plan.states)), state, strict=True):
        if not np.isfinite(x).all():
            return f"{name} is {x.tolist()}, expected finite numbers"
    lost = ~np.isfinite(held).all(axis=1)
    k = int(np.argmax(lost))
    return f"tau is {held[k].tolist()} at t = {k * dt:.9g} s, expected finite numbers" if lost.any() else ""


def _value_not_finite(plan: Plan, b: int) -> str:
    """Which value of a sample's control law is not finite; "" if all are finite."""
    if plan.feedback is None:
        return ""
    for name, x in plan.feedback.values.items():  # except those of a cost, whose sum is named with its time
        if not (is_of_cost(own_name(name)) or np.isfinite(x[min(b, len(x) - 1)]).all()):
            what = f'{own_name(name)} of spec "{plan.feedback.spec.name}"'
            return f"{what} has numbers that are not finite, expected finite ones"
    return ""


def _alone(
    plan: Plan, initial: RunStates, state: list[Array], held: Array, records: Sequence[Array],
    steps: tuple[float, int, int], sample: int,
) -> str:  # fmt: skip
    """Run a sample as ``simulate`` does; write its records, NaN after a failure. Returns its reason, "" without one."""
    (dt, total, every), (q, v, *own), lost = steps, state, ""
    if not all(np.isfinite(x).all() for x in state):
        for made in records:
            made[:] = np.nan
        return ""
    alone = RunStates(initial.arguments, initial.shapes, tuple(x[None] for x in own))
    recorder = Recorder(plan, Steps(dt, total, 0.0), every, alone)
    torque = Torque(np.ascontiguousarray(held))
    p = calls["momentum"](plan.model, q, v) if recorder.moves_p else v
    recorder.put(q, p, torque.held[0])
    try:
        run_sample(plan, recorder, (q, v, p), torque, None, sample)
    except SimulationError as error:
        lost = str(error)
    done, whole = int(recorder.at[1]), len(records[0])
    with np.errstate(over="ignore"):
        for made, rows in zip(records, recorder.velocities(), strict=True):
            made[: done - 1] = rows[1 : whole + 1]
            made[done - 1 :] = np.nan
    return lost


def check_solved(plan: Plan, records: Sequence[Array], dt: float, every: int) -> None:
    """Raise SimulationError for samples whose friction or contacts are not solved."""

    names, own = [x.name for x in plan.states], records[2:]

    def failure(rows: Sequence[Array], k: int) -> str:
        states = {name: x.astype(float) for name, x in zip(names, rows, strict=True)}
        return plan.failure(states, dt, (k + 1) * every * dt)

    last = records[0].shape[1] - 1
    if not len(records[0]) or not failure([np.fmax.reduce(x[:, last]) for x in own], last):  # of all samples at once
        return
    bad = [b for b in range(len(records[0])) if failure([x[b, last] for x in own], last)]
    reason = next(found for k in range(last + 1) if (found := failure([x[bad[0], k] for x in own], k)))
    raise SimulationError(f"sample {bad[0]}: {reason} ({len(bad)} samples in all); check=False lets it")


# --- by a program ---------------------------------------------------------------------------------------


def on_lanes(
    plan: Plan, states: Sequence[Array], tau: Array | None, records: Sequence[Array], steps: tuple[float, int, int]
) -> NDArray[np.intp] | None:
    """Run samples side by side through all steps and write records; returns the samples that the program rejects, or
    None if not applicable.

    The arguments are those of ``run_samples``.
    """
    (dt, total, every), model = steps, plan.model
    if not plan.is_program:
        return None
    if plan.method not in EXPLICIT_METHODS:
        return _in_momenta(plan, states, tau, records, steps)
    forced = tau is not None
    given = [np.full((1, 1, 1), dt), *(() if tau is None else (tau,)), *plan.step_values]
    if numba_kernels.PLAIN:
        made = plan.recorded(forced)
        return None if made is None else time_loop.replay(made.program, states, given, records, total, every)
    dtype = records[0].dtype if in_range(model, states[0][0], records[0].dtype) else np.dtype(np.float64)
    common: tuple[int, ...] = ()
    if plan.feedback is not None:  # gains and paths of hundreds of numbers, shared by all samples
        others = [k for k, x in enumerate(given) if len(x) == 1]
        common = tuple(len(states) + k for k in others)
        if not all(np.isfinite(given[k]).all() for k in others):
            return np.arange(len(states[0]))
    kernel = plan.kernel((), forced, dtype, False, common)
    if kernel is None:
        return None
    found = records if dtype == records[0].dtype else [np.empty(x.shape, dtype) for x in records]
    with np.errstate(over="ignore"):
        start, inputs = [x.astype(dtype, copy=False) for x in states], [x.astype(dtype, copy=False) for x in given]
        left = time_loop.run(kernel, start, [StepInput(x) for x in inputs], found, total, every)
        for x, y in zip(records, found, strict=True):
            if x is not y:
                x[...] = y
    return left


def _in_momenta(
    plan: Plan, states: Sequence[Array], tau: Array | None, records: Sequence[Array], steps: tuple[float, int, int]
) -> NDArray[np.intp] | None:
    """``on_lanes`` for a method in momenta, in float64: its equations are solved to rounding."""
    (dt, total, every), model = steps, plan.model
    kernel = None if numba_kernels.PLAIN else plan.kernel((), tau is not None, np.float64, False)
    if kernel is None or not records[0].size:
        return None
    sound = np.flatnonzero(np.isfinite(states[0]).all(axis=1) & np.isfinite(states[1]).all(axis=1))
    forcing = [np.full((1, 1, 1), dt), *(() if tau is None else (tau,)), *plan.step_values]
    inputs = [StepInput(np.ascontiguousarray(x if len(x) == 1 else x[sound], float)) for x in forcing]
    q, v = (np.ascontiguousarray(x[sound], float) for x in states)
    try:
        p = calls["momentum"](model, q, v)
        made = [np.empty((len(sound), *x.shape[1:])) for x in records]
        left = time_loop.run(kernel, [q, p, *begun(model, plan.method, q, p)], inputs, made, total, every)
        done = np.setdiff1d(np.arange(len(sound)), left)
        made[1][done] = calls["velocity_from_momentum"](model, made[0][done], made[1][done])
    except SpatialDynError:  # of one sample; a run of that sample alone names it
        return None
    with np.errstate(over="ignore"):
        for x, y in zip(records, made, strict=True):
            x[sound[done]] = y[done]
    return np.setdiff1d(np.arange(len(states[0])), sound[done])


def in_range(model: Model, q: Array, dtype: np.dtype[Any]) -> bool:
    """Whether the model's numbers, and the diagonal of M at q, are in the range of a dtype."""
    if dtype == np.float64:
        return True
    diagonal = np.diagonal(calls["crba"](model, q))
    return not float32_range.beyond(model.bodies) and bool(
        ((diagonal >= float32_range.LEAST) & (diagonal <= float32_range.MOST)).all()
    )
