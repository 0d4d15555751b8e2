"""Explicit methods by one program: of one sample on one lane, three to six times the speed of the table kernel, or of
many samples side by side.

Whether there is a program depends on the robot, what acts, the method and the kind of torque, never on the number of
steps or samples: it runs from the first step on if there is one, with the same bits for one and for many. From the
first step to which it has no answer (an angle beyond its range, a state that is not finite) the recursions run, a few
steps in plain Python, then as table kernels.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..calls.dynamics import calls
from ..engines.compiled import numba_kernels
from ..engines.programs.record import recording
from ..engines.programs.record.program import Program
from ..engines.programs.run import batch_kernels, time_loop
from ..engines.programs.run.time_loop import StepInput
from ..engines.programs.transform import float32_range
from ..model.model import Model
from ..recursions.spec import Argument, Spec
from .effects.control import Feedback, step_kernel
from .effects.effect import Effect, find
from .methods.methods import EXPLICIT_METHODS
from .plan import Plan
from .recorder import Recorder
from .steps import step_specs
from .system import State
from .torques import Torque

Array = NDArray[Any]
Slice = Callable[[int, int, float], bool]


def is_program(plan: Plan) -> bool:
    """Whether a step may be a program: of an explicit method, of few equations and points, without callables."""
    contact, constraints = plan.contact, plan.scene.constraints
    few = constraints is None or constraints.nc <= recording.MOST_EQUATIONS
    return plan.method in EXPLICIT_METHODS and few and plan.force is None and not (contact and contact.is_long)


@lru_cache(maxsize=batch_kernels.CACHE_SIZE)
def _kernel(
    model: Model, method: str, effects: tuple[Effect, ...], works: tuple[Argument, ...], static: tuple[Any, ...],
    forced: bool = True, dtype: Any = np.float64, one: bool = True,
) -> Any:  # fmt: skip
    specs = step_specs(method, effects, works, forced)
    if not recording.fits(specs, model.bodies, static=static):
        return None
    return step_kernel(specs, model, static, dtype, one=one, by_content=find(effects, Feedback) is not None)


def program(plan: Plan, recorder: Recorder, torque: Torque, state: State, sample: int = 0) -> Slice | None:
    """``(first, count, h) -> done``: takes and records these steps of h and advances the state; returns False, with
    nothing changed, if the program has no answer to one of them. None if not applicable.
    """
    model, steps = recorder.model, recorder.steps
    if numba_kernels.PLAIN or torque.user is not None or not is_program(plan):
        return None
    kernel = _kernel(model, plan.method, plan.structure, plan.work, plan.tables)
    if kernel is None:
        return None
    values = [x[min(sample, len(x) - 1)][None] for x in plan.values.values()]
    q_rows, w_rows, tau_rows = recorder.rows
    now = [state.q, state.w, *(recorder.own[at] for at in recorder.states.slices)]

    def run(first: int, count: int, h: float) -> bool:
        every = recorder.every if first % recorder.every == count % recorder.every == 0 else count
        torques = torque.held if len(torque.held) == 1 else torque.held[first : first + count]
        records = [np.empty((1, count // every, len(x))) for x in now]
        forcing = [StepInput(np.full((1, 1, 1), h)), StepInput(np.ascontiguousarray(torques[None]))]
        for x in values:
            forcing.append(StepInput(x if x.shape[1] == 1 else np.ascontiguousarray(x[:, first : first + count])))
        if len(time_loop.run(kernel, [x[None] for x in now], forcing, records, count, every)):
            return False
        for x, (rows,) in zip(now, records, strict=True):
            x[:] = rows[-1]
        (q,), (w,) = records[:2]
        done = first + count
        if done % recorder.every == 0 or done == steps.total:
            row, more = int(recorder.at[1]), len(q)
            after = np.minimum(np.arange(first + every, done + 1, every), len(torque.held) - 1)
            q_rows[row : row + more], w_rows[row : row + more] = q, w
            tau_rows[row : row + more] = torque.held[after]
            recorder.own_rows[row : row + more] = np.concatenate(
                [np.empty((more, 0)), *(x for (x,) in records[2:])], axis=1
            )
            recorder.at[1] += more
        recorder.at[0] += count
        return True

    return run


def slice_of(first: int, count: int, every: int) -> int:
    """How many of ``count`` steps to take at once: up to the next sample, or a whole number of samples."""
    if first % every == 0 and count >= every:
        return count - count % every
    return min(count, every - first % every)


def on_lanes(
    plan: Plan, states: Sequence[Array], tau: Array | None, records: Sequence[Array], steps: tuple[float, int, int]
) -> NDArray[np.intp] | None:
    """Run samples side by side through all steps, and write records; returns those without an answer. None if not
    applicable.

    The arguments are those of ``driver.run_samples``.
    """
    (dt, total, every), model = steps, plan.model
    if not is_program(plan):
        return None
    forced = tau is not None
    given = [np.full((1, 1, 1), dt), *(() if tau is None else (tau,)), *plan.values.values()]
    if numba_kernels.PLAIN:
        recorded = _recorded(model, step_specs(plan.method, plan.structure, (), forced), plan.tables)
        return None if recorded is None else time_loop.replay(recorded, states, given, records, total, every)
    dtype = records[0].dtype if _holds(model, states[0][0], records[0].dtype) else np.dtype(np.float64)
    kernel = _kernel(model, plan.method, plan.structure, (), plan.tables, forced, dtype, False)
    if kernel is None:
        return None
    made = records if dtype == records[0].dtype else [np.empty(x.shape, dtype) for x in records]
    with np.errstate(over="ignore"):
        start, inputs = [x.astype(dtype, copy=False) for x in states], [x.astype(dtype, copy=False) for x in given]
        left = time_loop.run(kernel, start, [StepInput(x) for x in inputs], made, total, every)
        for x, y in zip(records, made, strict=True):
            if x is not y:
                x[...] = y
    return left


@lru_cache(maxsize=32)
def _recorded(model: Model, specs: tuple[Spec, ...], static: tuple[Any, ...]) -> Program | None:
    fits = recording.fits(specs, model.bodies, static=static)
    return recording.record(specs, model.bodies, static).program if fits else None


def _holds(model: Model, q: Array, dtype: np.dtype[Any]) -> bool:
    """Whether the model's numbers, and the diagonal of M at q, are in the range of a dtype."""
    if dtype == np.float64:
        return True
    diagonal = np.diagonal(calls["crba"](model, q))
    return not float32_range.beyond(model.bodies) and bool(
        ((diagonal >= float32_range.LEAST) & (diagonal <= float32_range.MOST)).all()
    )
