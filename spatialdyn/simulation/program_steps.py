"""Explicit methods as one program on one lane: three to six times the speed of the table kernel.

The choice between the two depends on the model, the method and the kind of torque, never on the number of steps: the
program runs from the first step on if there is one. From the first step to which it has no answer (an angle beyond its
range, a state that is not finite) the recursions run, a few steps in plain Python, then as table kernels.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np

from ..engines.compiled import numba_kernels
from ..engines.programs import batch_kernels, recording, time_loop
from ..engines.programs.time_loop import StepInput
from ..model.model import Model
from ..recursions.spec import Argument
from .effects.control import Feedback, step_kernel
from .effects.effect import Effect, find
from .methods import EXPLICIT_METHODS, Method
from .plan import Plan
from .recorder import Recorder
from .steps import step_specs
from .system import State
from .torques import Torque

# Rows of the table times forward dynamics per step: 85 to 350 operations of the program each, 0.1 ms to compile one.
# At the limit that is 3 s once per model, and the code (600 kB) exceeds the caches: twice the table kernel's speed.
MOST = 128

Slice = Callable[[int, int, float], bool]


def program(plan: Plan, recorder: Recorder, torque: Torque, state: State, sample: int = 0) -> Slice | None:
    """``(first, count, h) -> done``: takes and records these steps of h and advances the state; returns False, with
    nothing changed, if the program has no answer to one of them. None if not applicable.
    """
    model, steps, method = recorder.model, recorder.steps, recorder.method
    long = plan.contact is not None and plan.contact.is_long
    if plan.method not in EXPLICIT_METHODS or torque.user is not None or plan.force is not None or long:
        return None
    kernel = _kernel(model, method, plan.structure, plan.work, plan.tables)
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


@lru_cache(maxsize=batch_kernels.CACHE_SIZE)
def _kernel(
    model: Model, method: Method, effects: tuple[Effect, ...], work: tuple[Argument, ...], static: tuple[Any, ...]
) -> Any:
    specs = step_specs(method.name, effects, work)
    rows = (method.evaluations + 2 * len(static)) * (len(model.bodies) - 1)
    if numba_kernels.PLAIN or rows > MOST or not recording.fits(specs, model.bodies, static=static):
        return None
    return step_kernel(specs, model, static, one=True, by_content=find(effects, Feedback) is not None)
